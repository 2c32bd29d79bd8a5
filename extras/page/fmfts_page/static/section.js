// The pad cut through the magnet (x to the right, z up), and the magnet alone, enlarged around its place at rest.

import { known, posesOf, shown, touchesOf, touchOf } from "./numbers.js";
import { begin, colour, disc, faded, halfSide, hatch, label, slab } from "./paint.js";
import { sensorStates } from "./pads.js";

const ARROW_M_PER_N = 0.003, LENSES_M = [5e-5, 1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3], LENS_HOLD_MS = 2500;

export function drawSection(canvas, pad, contact) {
  const [ctx, width, height] = begin(canvas);
  const { shape } = pad, half = halfSide(shape), [bottom, top] = slab(shape);
  const reach = top + 2.1 * ARROW_M_PER_N + 0.001;
  const scale = Math.min((width - 24) / (2 * half), (height - 14) / (reach + 0.003));
  if (scale <= 0) return;
  ctx.translate(width / 2, height - 8 - 0.0025 * scale);
  const rect = (x0, z0, x1, z1) => {
    ctx.beginPath();
    ctx.rect(x0 * scale, -z1 * scale, (x1 - x0) * scale, (z1 - z0) * scale);
  };
  rect(-half, bottom, half, top);
  ctx.fillStyle = colour.silicone;
  ctx.fill();
  ctx.strokeStyle = colour["silicone-edge"];
  ctx.lineWidth = 1.3;
  ctx.stroke();
  rect(-half, -0.0018, half, -0.0006); // the board below the chips
  ctx.fillStyle = colour.line;
  ctx.fill();
  const states = sensorStates(contact, pad.status, shape.sensors_m.length);
  shape.sensors_m.forEach(([x, , z], number) => {
    rect(x - 0.0013, z - 0.0006, x + 0.0013, z + 0.0006);
    ctx.fillStyle = colour[states[number] === "good" ? "ok" : states[number] === "left out" ? "warn" : states[number] === "not known" ? "muted" : "bad"];
    faded(ctx, 0.85, () => ctx.fill());
  });
  const poses = posesOf(contact);
  for (const { position_m: [x, , z], axis } of poses) drawCylinder(ctx, x * scale, -z * scale, shape, axis, scale);
  if (!poses.length) {
    hatch(ctx, () => rect(-half, bottom, half, top), colour.veil, 12, 0.35);
    label(ctx, contact ? "pose not known" : "nothing arrives", 0, (-(bottom + top) / 2) * scale, { px: 13, weight: 650, fill: colour.bad });
  }
  const over = touchOf(contact) === "over";
  if (over && !touchesOf(contact).length) label(ctx, "▲ place not known", 0, -top * scale - 26, { px: 13, weight: 650, fill: colour.bad });
  for (const touch of touchesOf(contact)) drawForce(ctx, touch, over, over ? contact.force_min_n : touch.force_n, top, scale);
  label(ctx, "sensors", half * scale, -0.0022 * scale - 6, { px: 11, align: "right" });
  if (poses.length) label(ctx, heightOf(poses), -half * scale, -0.0022 * scale - 6, { px: 11, align: "left" });
}

// The height of the magnet, or of the lowest and the highest of several.
function heightOf(poses) {
  const heights = poses.map((pose) => pose.position_m[2] * 1e3), decimals = poses.length > 1 ? 1 : 2;
  const [low, high] = [Math.min(...heights), Math.max(...heights)].map((height) => shown(height, decimals));
  return `z ${low === high ? low : `${low} to ${high}`} mm`;
}

// North's half in its own colour, turned as the magnet's axis is in this plane.
function drawCylinder(ctx, x, y, shape, axis, scale) {
  const wide = Math.max(shape.magnet_diameter_m * scale, 6), long = Math.max(shape.magnet_length_m * scale, 6);
  ctx.save();
  ctx.translate(x, y);
  ctx.rotate(Math.atan2(axis[0], axis[2]));
  ctx.fillStyle = colour.north;
  ctx.fillRect(-wide / 2, -long / 2, wide, long / 2);
  ctx.fillStyle = colour.magnet;
  ctx.fillRect(-wide / 2, 0, wide, long / 2);
  ctx.restore();
}

function drawForce(ctx, contact, over, force, top, scale) {
  const x = contact.x_m * scale, tip = -top * scale, tall = Math.max((force ?? 0.5) * ARROW_M_PER_N * scale, 8);
  const tone = over ? colour.bad : colour.contact;
  if (known(contact.x_sd_m)) {
    ctx.fillStyle = colour.ellipse;
    faded(ctx, 0.5, () => ctx.fillRect(x - 2 * contact.x_sd_m * scale, tip - 2, Math.max(4 * contact.x_sd_m * scale, 1), 4));
  }
  ctx.strokeStyle = ctx.fillStyle = tone;
  ctx.lineWidth = 3;
  ctx.setLineDash(over || !known(force) ? [5, 4] : []);
  ctx.beginPath();
  ctx.moveTo(x, tip - tall - 6);
  ctx.lineTo(x, tip - 7);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.beginPath();
  ctx.moveTo(x, tip);
  ctx.lineTo(x - 6, tip - 10);
  ctx.lineTo(x + 6, tip - 10);
  ctx.fill();
}

let lens = LENSES_M[1], wideUntil = 0;

// Returns the half width of the enlarged view in m, for its caption.
export function drawLens(canvas, pad, contact) {
  const [ctx, width, height] = begin(canvas);
  const poses = posesOf(contact), rests = pad.shape.rest_positions_m ?? [pad.shape.rest_position_m];
  // How far each magnet is from its rest; nothing where the rests of several are not told.
  const moved = poses.length === rests.length ? poses.map(({ position_m, position_sd_m }, number) => ({ offset: position_m.map((value, axis) => value - rests[number][axis]), position_sd_m })) : [];
  const farthest = Math.max(0, ...moved.map(({ offset }) => Math.hypot(...offset)));
  const needed = LENSES_M.find((half) => farthest < 0.8 * half) ?? LENSES_M.at(-1);
  if (needed >= lens || performance.now() > wideUntil) {
    lens = needed;
    wideUntil = performance.now() + LENS_HOLD_MS;
  }
  const radius = height / 2 - 8;
  if (radius <= 0 || width <= 24) return lens;
  [[0, 1, "x", "y", "from above"], [0, 2, "x", "z", "section"]].forEach(([across, up, nameAcross, nameUp, caption], number) => {
    const cx = (width * (2 * number + 1)) / 4, r = Math.min(radius, width / 4 - 6), scale = r / lens;
    ctx.save();
    ctx.translate(cx, height / 2);
    disc(ctx, 0, 0, r);
    ctx.fillStyle = colour.faint;
    ctx.fill();
    ctx.strokeStyle = colour.line;
    ctx.lineWidth = 1.5;
    ctx.stroke();
    ctx.clip();
    ctx.beginPath();
    ctx.moveTo(-r, 0);
    ctx.lineTo(r, 0);
    ctx.moveTo(0, -r);
    ctx.lineTo(0, r);
    ctx.strokeStyle = colour.grid;
    ctx.lineWidth = 1;
    ctx.stroke();
    for (const { offset, position_sd_m } of moved) drawMoved(ctx, offset[across] * scale, -offset[up] * scale, position_sd_m[across] * scale, position_sd_m[up] * scale);
    if (!moved.length) label(ctx, "not known", 0, 0, { px: 12, weight: 650, fill: colour.bad });
    ctx.restore();
    label(ctx, caption, cx, height / 2 - r + 12, { px: 10.5 });
    label(ctx, nameAcross, cx + r - 8, height / 2 + 9, { px: 10.5 });
    label(ctx, nameUp, cx + 8, height / 2 - r + 26, { px: 10.5 });
  });
  return lens;
}

function drawMoved(ctx, x, y, sx, sy) {
  ctx.strokeStyle = colour.magnet;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(0, 0);
  ctx.lineTo(x, y);
  ctx.stroke();
  disc(ctx, x, y, Math.max(2 * sx, 1.5), Math.max(2 * sy, 1.5));
  ctx.fillStyle = colour.ellipse;
  faded(ctx, 0.25, () => ctx.fill());
  ctx.strokeStyle = colour.ellipse;
  ctx.lineWidth = 1.8;
  ctx.stroke();
  disc(ctx, x, y, 3);
  ctx.fillStyle = colour.magnet;
  ctx.fill();
}
