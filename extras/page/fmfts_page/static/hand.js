// All pads at once: where [pad.placement] says they sit, else in a grid. A button lies over each, for mouse and keys.

import { known, sentence, shown, touchOf } from "./numbers.js";
import { begin, colour, font, halfSide, label } from "./paint.js";
import { leastCovering } from "./spots.js";
import { drawPad } from "./top.js";

const LINE_PX = 15;

// "1.28 N", "> 2.13 N", or nothing where nothing touches or no force is known.
function shortForce(contact) {
  const touch = touchOf(contact);
  if (touch === "over") return known(contact.force_min_n) ? `> ${shown(contact.force_min_n, 2)} N` : "over range";
  return touch === "touch" && known(contact.force_n) ? `${shown(contact.force_n, 2)} N` : touch === "touch" ? "touched" : "";
}

// Places the pads: {x, y, turn} in m and rad, y up. Pads that would lie over each other go into a grid.
export function placed(pads) {
  const seen = pads.map((pad) => {
    const [x, y] = pad.shape.placement_m ?? [0, 0], rotation = pad.shape.placement_rotation;
    return { pad, x, y, turn: rotation ? Math.atan2(rotation[1][0], rotation[0][0]) : 0 };
  });
  const apart = (one, other) => Math.hypot(one.x - other.x, one.y - other.y) >= 0.9 * (halfSide(one.pad.shape) + halfSide(other.pad.shape));
  if (seen.every((one, i) => seen.slice(i + 1).every((other) => apart(one, other)))) return seen;
  const columns = Math.ceil(Math.sqrt(pads.length)), step = 2.35 * Math.max(...pads.map((pad) => halfSide(pad.shape)));
  return pads.map((pad, i) => ({ pad, x: (i % columns) * step, y: -Math.floor(i / columns) * step, turn: 0 }));
}

export class Hand {
  constructor(canvas, buttons, choose) {
    this.canvas = canvas;
    this.buttons = buttons;
    this.choose = choose;
    this.places = [];
    this.named = "";
  }

  setPads(pads) {
    const named = JSON.stringify(pads.map((pad) => [pad.name, pad.shape.placement_m]));
    if (named === this.named) return;
    this.named = named;
    this.places = placed(pads);
    this.buttons.replaceChildren(
      ...this.places.map((place) => {
        const button = document.createElement("button");
        button.addEventListener("click", () => this.choose(place.pad.name));
        place.button = button;
        return button;
      }),
    );
    this.fitted = "";
  }

  // Scale and offset with which all pads fit; moves the buttons where they changed.
  fit(width, height) {
    const key = `${this.named} ${width} ${height}`;
    if (key === this.fitted) return;
    this.fitted = key;
    const reach = (place) => this.reach(place) + 0.1 * halfSide(place.pad.shape);
    const xs = this.places.flatMap((place) => [place.x - reach(place), place.x + reach(place)]);
    const ys = this.places.flatMap((place) => [place.y - reach(place), place.y + reach(place)]);
    const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    this.scale = Math.min(width / (x1 - x0), (height - 40) / (y1 - y0));
    this.middle = [(x0 + x1) / 2, (y0 + y1) / 2];
    for (const place of this.places) {
      const half = halfSide(place.pad.shape) * this.scale, [x, y] = this.at(place, width, height);
      Object.assign(place.button.style, { left: `${x - half}px`, top: `${y - half}px`, width: `${2 * half}px`, height: `${2 * half}px` });
    }
  }

  at(place, width, height) {
    return [width / 2 + (place.x - this.middle[0]) * this.scale, height / 2 - (place.y - this.middle[1]) * this.scale];
  }

  draw(chosen, contactOf) {
    const [ctx, width, height] = begin(this.canvas);
    if (!this.places.length) return;
    this.fit(width, height);
    if (this.scale <= 0) return;
    for (const place of this.places) {
      const { pad } = place, contact = contactOf(pad), half = halfSide(pad.shape) * this.scale, [x, y] = this.at(place, width, height);
      ctx.save();
      ctx.translate(x, y);
      ctx.rotate(-place.turn);
      drawPad(ctx, pad, contact, this.scale, false);
      if (pad.name === chosen) {
        ctx.strokeStyle = colour.accent;
        ctx.lineWidth = 2.5;
        ctx.strokeRect(-half - 3, -half - 3, 2 * half + 6, 2 * half + 6);
      }
      ctx.restore();
    }
    const taken = this.places.map((place) => this.box(place, width, height));
    for (const place of this.places) {
      if (halfSide(place.pad.shape) * this.scale > 16) this.label(ctx, place, taken, width, height, contactOf(place.pad), place.pad.name === chosen);
    }
  }

  // Half the height of a turned pad, in m.
  reach({ turn, pad }) {
    return (Math.abs(Math.cos(turn)) + Math.abs(Math.sin(turn))) * halfSide(pad.shape);
  }

  // What a turned pad covers.
  box(place, width, height) {
    const [x, y] = this.at(place, width, height), side = 2 * this.reach(place) * this.scale;
    return { x, y, wide: side, tall: side };
  }

  // The pad's name, its force, and what a fixed baseline would say: below the pad, above it, or in it, but over no other
  // pad and no other label. taken: their boxes; this label's is added.
  label(ctx, place, taken, width, height, contact, chosen) {
    const { pad } = place, bad = contact && (contact.health !== "ok" || contact.over_range);
    const own = this.box(place, width, height), force = shortForce(contact), style = { px: 12, weight: chosen || force ? 700 : 500, fill: bad ? colour.bad : colour.ink };
    const wideOf = ([text, { px, weight }]) => ((ctx.font = font(px, weight)), ctx.measureText(text).width);
    const line = [`${pad.name}${force ? `  ${force}` : ""}`, style];
    const lines = wideOf(line) <= own.wide ? [line] : [[pad.name, style], [force, style]];
    if (pad.ghost && contact) lines.push([`fixed: ${known(pad.ghost.force_n) ? `${shown(pad.ghost.force_n, 2)} N` : "–"}`, { px: 11.5, weight: 600, fill: colour.ghost }]);
    const wide = Math.max(...lines.map(wideOf)), tall = LINE_PX * lines.length, off = (own.tall + tall) / 2 + 2;
    const spots = [off, -off, (own.tall - tall) / 2 - 3].map((dy) => ({ x: own.x, y: own.y + dy, wide, tall }));
    const spot = leastCovering(spots, taken.filter((_, number) => this.places[number] !== place));
    taken.push(spot);
    lines.forEach(([text, own], number) => label(ctx, text, spot.x, spot.y + (number - (lines.length - 1) / 2) * LINE_PX, own));
  }

  // Text alternatives; called once a second.
  describe(chosen, contactOf) {
    for (const { pad, button } of this.places) {
      button.setAttribute("aria-label", `pad ${pad.name}: ${sentence(contactOf(pad))}`);
      button.setAttribute("aria-current", String(pad.name === chosen));
    }
  }
}
