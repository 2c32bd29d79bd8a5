// What all drawings share: colours of the theme, sharp canvases, hatching, and the pad's outline.

const NAMES = ["ground", "panel", "ink", "muted", "line", "faint", "accent", "ok", "warn", "bad", "silicone", "silicone-edge", "contact", "ellipse", "magnet", "north", "ghost", "grid", "veil"];
export const colour = {};

export function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colour[name] = style.getPropertyValue(`--${name}`).trim();
}

export const font = (px, weight = 400) => `${weight} ${px}px system-ui, "Segoe UI", Roboto, "Noto Sans", sans-serif`;

// Makes a canvas as sharp as the screen. Returns [context, width, height] in CSS pixels, cleared.
export function begin(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const ctx = canvas.getContext("2d");
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, height);
  return [ctx, width, height];
}

export function faded(ctx, alpha, draw) {
  ctx.globalAlpha = alpha;
  draw();
  ctx.globalAlpha = 1;
}

// Lines at 45° inside a path: what is not known, or over range, so that it does not look like a measurement.
export function hatch(ctx, path, stroke, step, alpha = 0.5, width = 1.5) {
  ctx.save();
  path();
  ctx.clip();
  const { a, e, f } = ctx.getTransform();
  ctx.setTransform(a, 0, 0, a, e, f);
  ctx.globalAlpha = alpha;
  ctx.strokeStyle = stroke;
  ctx.lineWidth = width;
  ctx.beginPath();
  for (let at = -1500; at < 1500; at += step) {
    ctx.moveTo(at - 750, -750);
    ctx.lineTo(at + 750, 750);
  }
  ctx.stroke();
  ctx.restore();
}

export function disc(ctx, x, y, rx, ry = rx) {
  ctx.beginPath();
  ctx.ellipse(x, y, Math.max(rx, 0.01), Math.max(ry, 0.01), 0, 0, 2 * Math.PI);
}

export function label(ctx, text, x, y, { px = 12, weight = 400, fill = colour.muted, align = "center", base = "middle", halo = true } = {}) {
  ctx.font = font(px, weight);
  ctx.textAlign = align;
  ctx.textBaseline = base;
  if (halo) {
    ctx.lineWidth = 3.5;
    ctx.lineJoin = "round";
    ctx.strokeStyle = colour.panel;
    ctx.strokeText(text, x, y);
  }
  ctx.fillStyle = fill;
  ctx.fillText(text, x, y);
}

// Half the side of the pad, in m. The configuration does not tell it: sensors lie as far inside as the magnet is high.
export function halfSide(shape) {
  const reach = Math.max(...shape.sensors_m.flatMap(([x, y]) => [Math.abs(x), Math.abs(y)]), 0.004);
  return reach + Math.abs(shape.rest_position_m[2]);
}

// The slab of silicone holds the magnet with 1 mm above and below.
export const slab = (shape) => [shape.rest_position_m[2] - shape.magnet_length_m / 2 - 1e-3, shape.rest_position_m[2] + shape.magnet_length_m / 2 + 1e-3];

// Radius in m of the disc that shows a force: its area is the force, 40 mm² a newton.
export const forceRadius = (force) => Math.sqrt((Math.max(force, 0) * 40e-6) / Math.PI);
