// Tangential force as an arrow; once a slip has told the friction, also how long the arrow may become: the cone from above.
// Where the finger slipped, as a trail.

import { known, shown } from "./numbers.js";
import { colour, disc, faded, forceRadius, label } from "./paint.js";

const M_PER_N = 8e-3, SHORTEST = 3; // of the arrow; in pixels

// x, y: of the contact, in pixels; scale: pixels a metre.
export function drawShear(ctx, contact, x, y, scale) {
  const { slip } = contact;
  if (!known(contact.shear_x_n) || !known(contact.shear_y_n)) return;
  const tone = slip?.slipping ? colour.bad : colour.accent, length = M_PER_N * scale;
  const shear = Math.hypot(contact.shear_x_n, contact.shear_y_n);
  const most = known(slip?.friction) && known(contact.force_n) ? slip.friction * contact.force_n : null;
  if (most !== null) {
    disc(ctx, x, y, most * length);
    ctx.setLineDash([4, 4]);
    ctx.strokeStyle = tone;
    ctx.lineWidth = 1.5;
    ctx.stroke();
    ctx.setLineDash([]);
  }
  arrow(ctx, x, y, contact.shear_x_n * length, -contact.shear_y_n * length, tone);
  // Beside all of it, toward the middle, where there is room; the force is written below.
  const far = Math.max(forceRadius(contact.force_n ?? 0) * scale, Math.max(shear, most ?? 0) * length), side = x > 0 ? -1 : 1;
  const style = { px: 12, weight: 650, fill: tone };
  if (shear * length >= SHORTEST) label(ctx, `shear ${shown(shear, 2)} N`, x + side * (far + 6), y, { ...style, align: side > 0 ? "left" : "right" });
  const above = slip?.slipping ? `slips, ${shown(slip.speed_m_per_s * 1e3, 0)} mm/s` : most === null ? "" : `slips at ${shown(most, 2)} N`;
  if (above) label(ctx, above, x, y - far - 9, style);
}

// slid: of a PadState.
export function drawSlid(ctx, slid, scale) {
  ctx.strokeStyle = colour.bad;
  ctx.lineWidth = 4;
  ctx.beginPath();
  slid.forEach(([, x, y], i) => ctx[slid[i - 1]?.[3] ? "lineTo" : "moveTo"](x * scale, -y * scale));
  faded(ctx, 0.6, () => ctx.stroke());
}

function arrow(ctx, x, y, dx, dy, tone) {
  const long = Math.hypot(dx, dy), head = Math.min(8, long / 2);
  if (long < SHORTEST) return;
  const ux = dx / long, uy = dy / long;
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.lineTo(x + dx, y + dy);
  for (const side of [1, -1]) {
    ctx.moveTo(x + dx, y + dy);
    ctx.lineTo(x + dx - head * (ux - side * uy * 0.6), y + dy - head * (uy + side * ux * 0.6));
  }
  for (const [width, style] of [[6, colour.panel], [3, tone]]) { // with a rim: it lies on the contact's disc
    ctx.lineWidth = width;
    ctx.strokeStyle = style;
    ctx.stroke();
  }
}

// In words beside the numbers; "" where nothing is told.
export function slipWords({ slip }) {
  if (!slip || !known(slip.sticking_probability)) return "";
  const friction = known(slip.friction) ? `; friction ${shown(slip.friction, 2)}` : "";
  return `; ${slip.slipping ? `slips at ${shown(slip.speed_m_per_s * 1e3, 0)} mm/s` : `sticks${known(slip.margin_n) ? ` until ${shown(slip.margin_n, 2)} N more shear` : ""}`}${friction}`;
}
