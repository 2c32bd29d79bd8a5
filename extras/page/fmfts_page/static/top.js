// The pad from above, to scale: outline, sensors, magnet, contact with its uncertainty. x to the right, y up.

import { atMost, forceText, known, posesOf, touchesOf, touchOf, shown } from "./numbers.js";
import { begin, colour, disc, faded, font, forceRadius, halfSide, hatch, label } from "./paint.js";
import { sensorStates } from "./pads.js";
import { drawShear, drawSlid } from "./shear.js";
import { freeSpot, widestLabel } from "./spots.js";

const SENSOR_M = 0.0026, UNSEEN = ["stale", "disconnected", "no_baseline", "lost", "disturbed"];

export function drawTop(canvas, pad, contact) {
  const [ctx, width, height] = begin(canvas);
  const half = halfSide(pad.shape), scale = Math.min(width / 2 - 34, height / 2 - 20) / half; // room for the numbers
  if (scale <= 0) return; // of a canvas without room a browser refuses what is drawn
  ctx.translate(width / 2, height / 2);
  drawAxes(ctx, half, scale);
  drawPad(ctx, pad, contact, scale, true);
}

// The pad around (0, 0) of the context; scale in pixels a metre. full: with figures, for the large drawing.
export function drawPad(ctx, pad, contact, scale, full) {
  const { shape } = pad, half = halfSide(shape) * scale;
  const outline = () => {
    ctx.beginPath();
    ctx.roundRect(-half, -half, 2 * half, 2 * half, Math.min(half * 0.08, 14));
  };
  outline();
  ctx.fillStyle = colour.silicone;
  ctx.fill();
  ctx.lineWidth = full ? 1.5 : 1;
  ctx.strokeStyle = colour["silicone-edge"];
  ctx.stroke();
  if (full) drawAxesCross(ctx, half);
  if (full && shape.calibrated_x_m) drawCalibrated(ctx, shape, scale);
  drawSensors(ctx, pad, contact, scale, full);
  if (!contact || UNSEEN.includes(contact.health)) drawVeil(ctx, outline, contact, half, full);
  for (const pose of posesOf(contact)) drawMagnet(ctx, pad, pose, scale, full);
  if (full && contact) { drawTrail(ctx, pad, scale); drawSlid(ctx, pad.slid, scale); }
  if (contact) drawContact(ctx, pad, contact, scale, half, full);
  if (pad.ghost && contact) drawGhost(ctx, pad.ghost, scale, half, full);
}

function drawAxes(ctx, half, scale) {
  const side = half * scale;
  ctx.strokeStyle = colour.grid;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let mm = -Math.floor(half * 100) * 10; mm <= half * 1e3; mm += 10) {
    const at = (mm / 1e3) * scale;
    ctx.moveTo(at, side);
    ctx.lineTo(at, side + 5);
    ctx.moveTo(-side, at);
    ctx.lineTo(-side - 5, at);
    const text = mm === 0 ? "0" : shown(mm, 0);
    label(ctx, text, at, side + 13, { px: 11 });
    label(ctx, mm === 0 ? "0" : shown(-mm, 0), -side - 8, at, { px: 11, align: "right" });
  }
  ctx.stroke();
}

// Which way x and y point, in the lower left corner.
function drawAxesCross(ctx, half) {
  const x = -half + 14, y = half - 14, arm = 20;
  ctx.strokeStyle = colour.muted;
  ctx.lineWidth = 1.4;
  ctx.beginPath();
  ctx.moveTo(x, y - arm);
  ctx.lineTo(x, y);
  ctx.lineTo(x + arm, y);
  ctx.moveTo(x - 3, y - arm + 5);
  ctx.lineTo(x, y - arm);
  ctx.lineTo(x + 3, y - arm + 5);
  ctx.moveTo(x + arm - 5, y - 3);
  ctx.lineTo(x + arm, y);
  ctx.lineTo(x + arm - 5, y + 3);
  ctx.stroke();
  label(ctx, "x", x + arm + 7, y, { px: 11, halo: false });
  label(ctx, "y", x, y - arm - 7, { px: 11, halo: false });
}

function drawCalibrated(ctx, shape, scale) {
  const [x0, x1] = shape.calibrated_x_m, [y0, y1] = shape.calibrated_y_m;
  ctx.setLineDash([2, 5]);
  ctx.strokeStyle = colour["silicone-edge"];
  ctx.strokeRect(x0 * scale, -y1 * scale, (x1 - x0) * scale, (y1 - y0) * scale);
  ctx.setLineDash([]);
  label(ctx, "calibrated", x1 * scale - 4, -y0 * scale + 9, { px: 10.5, align: "right", halo: false });
}

const SENSOR_COLOUR = { good: "ok", "left out": "warn", saturated: "bad", silent: "bad", "not known": "muted" };

// In pixels: a sensor's number must fit where there are figures.
const sensorSide = (scale, full) => Math.max(SENSOR_M * scale, full ? 14 : 4);

function drawSensors(ctx, pad, contact, scale, full) {
  const side = sensorSide(scale, full), states = sensorStates(contact, pad.status, pad.shape.sensors_m.length);
  const room = widestLabel(pad.shape.sensors_m, scale, 14);
  pad.shape.sensors_m.forEach(([x, y], number) => {
    const state = states[number], px = x * scale, py = -y * scale, tone = colour[SENSOR_COLOUR[state]];
    ctx.strokeStyle = ctx.fillStyle = tone;
    ctx.lineWidth = full ? 1.8 : 1.2;
    ctx.setLineDash(state === "left out" || state === "not known" ? [3, 3] : []);
    ctx.beginPath();
    ctx.roundRect(px - side / 2, py - side / 2, side, side, 2);
    if (state === "good") faded(ctx, 0.22, () => ctx.fill());
    ctx.stroke();
    ctx.setLineDash([]);
    if (state === "saturated") {
      ctx.beginPath();
      ctx.moveTo(px, py - side * 0.36);
      ctx.lineTo(px + side * 0.36, py + side * 0.3);
      ctx.lineTo(px - side * 0.36, py + side * 0.3);
      ctx.fill();
    } else if (state === "silent") {
      ctx.beginPath();
      for (const turn of [1, -1]) {
        ctx.moveTo(px - side * 0.3, py - side * 0.3 * turn);
        ctx.lineTo(px + side * 0.3, py + side * 0.3 * turn);
      }
      ctx.stroke();
    }
    if (!full) return;
    const style = { px: 11, weight: 600, fill: tone, halo: state !== "good" }, words = `${number + 1} ${state}`;
    ctx.font = font(style.px, style.weight);
    const fits = state !== "good" && ctx.measureText(words).width < room; // else the list beside the drawing has the words
    label(ctx, fits ? words : `${number + 1}`, px, py + (state === "good" ? 0.5 : side * 0.5 + 9), style);
  });
}

function drawVeil(ctx, outline, contact, half, full) {
  hatch(ctx, outline, colour.veil, full ? 14 : 8, 0.35);
  const word = contact ? contact.health.replace("_", " ") : "nothing arrives";
  label(ctx, word, 0, full ? -half + 24 : 0, { px: full ? 17 : Math.max(9, Math.min(13, half / 4)), weight: 700, fill: colour.bad });
}

function drawMagnet(ctx, pad, pose, scale, full) {
  const [x, y] = pose.position_m, radius = (pad.shape.magnet_diameter_m / 2) * scale;
  disc(ctx, x * scale, -y * scale, Math.max(radius, 2));
  ctx.fillStyle = colour.magnet;
  faded(ctx, 0.9, () => ctx.fill());
  if (!full) return;
  const [sx, sy] = pose.position_sd_m;
  disc(ctx, x * scale, -y * scale, 2 * sx * scale, 2 * sy * scale);
  ctx.strokeStyle = colour.ellipse;
  ctx.lineWidth = 1.2;
  ctx.stroke();
  // Toward where the magnet's north pole leans; its length is the tilt, 1 mm a degree.
  const tilt = Math.atan2(Math.hypot(pose.axis[0], pose.axis[1]), Math.abs(pose.axis[2])) * (180 / Math.PI);
  const across = Math.hypot(pose.axis[0], pose.axis[1]) || 1, reach = radius + tilt * 1e-3 * scale;
  ctx.beginPath();
  ctx.moveTo(x * scale, -y * scale);
  ctx.lineTo((x * scale) + (pose.axis[0] / across) * reach, -(y * scale) - (pose.axis[1] / across) * reach);
  ctx.strokeStyle = colour.north;
  ctx.lineWidth = 2.5;
  ctx.stroke();
}

function drawTrail(ctx, pad, scale) {
  const { trail } = pad;
  if (trail.length < 2) return;
  ctx.strokeStyle = colour.contact;
  ctx.lineWidth = 2;
  const last = new Map(); // by finger
  trail.forEach(([, x, y, finger], i) => {
    const from = last.get(finger);
    last.set(finger, [x, y]);
    if (!from) return;
    faded(ctx, (0.35 * i) / trail.length, () => {
      ctx.beginPath();
      ctx.moveTo(from[0] * scale, -from[1] * scale);
      ctx.lineTo(x * scale, -y * scale);
      ctx.stroke();
    });
  });
}

function drawContact(ctx, pad, contact, scale, half, full) {
  const touch = touchOf(contact);
  if (touch === "unknown" && !UNSEEN.includes(contact.health)) {
    label(ctx, "contact not known", 0, full ? half - 18 : 0, { px: full ? 14 : 10, weight: 650, fill: colour.warn });
  }
  if (touch === "none" && full) label(ctx, ["no contact", atMost(contact, "")].filter(Boolean).join(", ").trim(), 0, half - 16, { px: 13 });
  if (touch === "none" || touch === "unknown") return;
  const touches = touchesOf(contact);
  if (touch === "over") {
    if (!touches.length) drawOverSomewhere(ctx, contact, half, full);
    touches.forEach((each, number) => drawOver(ctx, pad, contact, each.x_m * scale, -each.y_m * scale, scale, half, full, number === 0));
  } else if (touches.length) {
    for (const each of touches) drawTouch(ctx, each, scale, half, full);
    if (full) nameTouches(ctx, pad, contact, touches, scale, half);
    if (full && touches.length === 1) drawShear(ctx, contact, contact.x_m * scale, -contact.y_m * scale, scale);
  } else label(ctx, "touched", 0, full ? half - 16 : 0, { px: full ? 15 : 10, weight: 700, fill: colour.contact });
}

// One finger of the message, or its contact.
function drawTouch(ctx, contact, scale, half, full) {
  const x = contact.x_m * scale, y = -contact.y_m * scale, radius = forceRadius(contact.force_n ?? 0) * scale;
  disc(ctx, x, y, Math.max(radius, 2));
  ctx.fillStyle = colour.contact;
  faded(ctx, 0.5, () => ctx.fill());
  ctx.strokeStyle = colour.contact;
  ctx.lineWidth = full ? 2 : 1.2;
  ctx.stroke();
  if (known(contact.x_sd_m) && known(contact.y_sd_m)) {
    ctx.save();
    ctx.beginPath();
    ctx.rect(-half, -half, 2 * half, 2 * half);
    ctx.clip();
    disc(ctx, x, y, Math.max(2 * contact.x_sd_m * scale, 1), Math.max(2 * contact.y_sd_m * scale, 1));
    ctx.strokeStyle = colour.ellipse;
    ctx.lineWidth = full ? 2 : 1.2;
    ctx.stroke();
    ctx.restore();
  }
  if (full) cross(ctx, x, y, 5);
}

// The force of each finger beside it, with the finger's number, over no other finger.
function nameTouches(ctx, pad, message, touches, scale, half) {
  const discs = touches.map(({ x_m, y_m, x_sd_m, y_sd_m, force_n }) => ({
    x: x_m * scale, y: -y_m * scale, radius: Math.max(forceRadius(force_n ?? 0), 2 * Math.max(x_sd_m ?? 0, y_sd_m ?? 0)) * scale,
  }));
  // With room around each: a label beside another finger would be read as its own.
  const taken = discs.map(({ x, y, radius }) => ({ x, y, wide: 2 * radius + 24, tall: 2 * radius + 24 })), labels = [];
  touches.forEach(({ id, force_n }, number) => {
    const text = `${known(id) ? `${id}: ` : ""}${known(force_n) ? `${shown(force_n, 2)} N` : "force not known"}`;
    const others = [...taken.filter((_, other) => other !== number), ...labels];
    labels.push(labelBeside(ctx, pad, message, text, discs[number], scale, half, colour.ink, others));
  });
}

// Over range at a place that is not known: the whole pad, lest a disc be taken for a place.
function drawOverSomewhere(ctx, contact, half, full) {
  const pad = () => {
    ctx.beginPath();
    ctx.rect(-half, -half, 2 * half, 2 * half);
  };
  hatch(ctx, pad, colour.bad, full ? 14 : 7, 0.55, 2);
  if (!full) return;
  label(ctx, `▲ ${forceText(contact)}`, 0, -half + 24, { px: 18, weight: 700, fill: colour.bad });
  label(ctx, "place not known", 0, -half + 45, { px: 14, weight: 650, fill: colour.bad });
}

function drawOver(ctx, pad, contact, x, y, scale, half, full, named) {
  const radius = forceRadius(contact.force_min_n ?? 1) * scale * 1.25;
  hatch(ctx, () => disc(ctx, x, y, radius), colour.bad, full ? 9 : 5, 0.8, 2);
  disc(ctx, x, y, radius);
  ctx.setLineDash([7, 5]);
  ctx.strokeStyle = colour.bad;
  ctx.lineWidth = full ? 3 : 1.5;
  ctx.stroke();
  ctx.setLineDash([]);
  if (full && named) labelBeside(ctx, pad, contact, `▲ ${forceText(contact)}`, { x, y, radius }, scale, half, colour.bad);
}

// Where a fixed baseline puts the magnet and the contact; it believes itself in any field.
function drawGhost(ctx, ghost, scale, half, full) {
  const inside = (value) => Math.min(Math.max(value, -half), half);
  ctx.strokeStyle = colour.ghost;
  ctx.lineWidth = full ? 2.2 : 1.4;
  ctx.setLineDash(full ? [4, 4] : [3, 2]);
  if (ghost.magnet_m) {
    disc(ctx, inside(ghost.magnet_m[0] * scale), inside(-ghost.magnet_m[1] * scale), Math.max(0.0013 * scale, 3));
    ctx.stroke();
  }
  if (ghost.force_n >= 0.05) {
    disc(ctx, inside(ghost.x_m * scale), inside(-ghost.y_m * scale), Math.min(forceRadius(ghost.force_n) * scale, half));
    ctx.stroke();
  }
  ctx.setLineDash([]);
  const text = known(ghost.force_n) ? `${shown(ghost.force_n, 2)} N` : "no answer";
  if (full) label(ctx, `fixed baseline: ${text}`, half - 10, -half + 16, { px: 13, weight: 650, fill: colour.ghost, align: "right" });
}

function cross(ctx, x, y, arm) {
  ctx.strokeStyle = colour.ink;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(x - arm, y);
  ctx.lineTo(x + arm, y);
  ctx.moveTo(x, y - arm);
  ctx.lineTo(x, y + arm);
  ctx.stroke();
}

// A label beside a disc, where it covers no sensor, no magnet and none of the boxes `others`. Returns its own box.
function labelBeside(ctx, pad, contact, text, { x, y, radius }, scale, half, fill, others = []) {
  const style = { px: 18, weight: 700, fill };
  ctx.font = font(style.px, style.weight);
  const side = sensorSide(scale, true), states = sensorStates(contact, pad.status, pad.shape.sensors_m.length);
  const sensors = pad.shape.sensors_m.map(([sx, sy], number) => ({
    x: sx * scale, y: -sy * scale, wide: states[number] === "good" ? side : side + 60, tall: states[number] === "good" ? side : side + 36,
  }));
  const wide = Math.max(pad.shape.magnet_diameter_m * scale, 6);
  const magnets = posesOf(contact).map(({ position_m: [mx, my] }) => ({ x: mx * scale, y: -my * scale, wide, tall: wide }));
  const size = { wide: ctx.measureText(text).width + 6, tall: 22 };
  const [atX, atY] = freeSpot({ x, y, radius }, size, [...sensors, ...magnets, ...others], half);
  label(ctx, text, atX, atY, style);
  return { x: atX, y: atY, ...size };
}
