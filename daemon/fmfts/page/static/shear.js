// Tangential force as an arrow; once a slip has told the friction, also how long the arrow may become: the cone from above.
// Where the finger slipped, as a trail.

import { known, shown } from "./numbers.js";
import { colour, disc, faded, label } from "./paint.js";

const M_PER_N = 8e-3; // of the arrow

// x, y: of the contact, in pixels; scale: pixels a metre.
export function drawShear(ctx, contact, x, y, scale) {
  const { slip } = contact;
  if (!known(contact.shear_x_n) || !known(contact.shear_y_n)) return;
  const tone = slip?.slipping ? colour.bad : colour.accent, length = M_PER_N * scale;
  if (known(slip?.friction) && known(contact.force_n)) {
    disc(ctx, x, y, slip.friction * contact.force_n * length);
    ctx.setLineDash([4, 4]);
    ctx.strokeStyle = tone;
    ctx.lineWidth = 1.5;
    ctx.stroke();
    ctx.setLineDash([]);
  }
  arrow(ctx, x, y, contact.shear_x_n * length, -contact.shear_y_n * length, tone);
  if (slip?.slipping) label(ctx, `slips, ${shown(slip.speed_m_per_s * 1e3, 0)} mm/s`, x, y + 30, { px: 13, weight: 700, fill: colour.bad });
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
  if (long < 3) return;
  const ux = dx / long, uy = dy / long;
  ctx.strokeStyle = tone;
  ctx.lineWidth = 3;
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.lineTo(x + dx, y + dy);
  for (const side of [1, -1]) {
    ctx.moveTo(x + dx, y + dy);
    ctx.lineTo(x + dx - head * (ux - side * uy * 0.6), y + dy - head * (uy + side * ux * 0.6));
  }
  ctx.stroke();
}

// In words beside the numbers; "" where nothing is told.
export function slipWords({ slip }) {
  if (!slip || !known(slip.sticking_probability)) return "";
  const friction = known(slip.friction) ? `; friction ${shown(slip.friction, 2)}, ${shown(slip.margin_n, 2)} N until it slips` : "";
  return `; ${slip.slipping ? `slips at ${shown(slip.speed_m_per_s * 1e3, 0)} mm/s` : "sticks"}${friction}`;
}
