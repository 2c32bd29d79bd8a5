// Where a label has room: boxes are {x, y, wide, tall} around their middle.

const overlap = (a, b) => Math.max(0, (a.wide + b.wide) / 2 - Math.abs(a.x - b.x)) * Math.max(0, (a.tall + b.tall) / 2 - Math.abs(a.y - b.y));

// How wide labels below places [x, y] m may be, in pixels, so that none lies over one beside it. tall: of a label, pixels.
export function widestLabel(places, scale, tall) {
  const gaps = places.flatMap(([x, y], one) => places.slice(one + 1).filter(([, other]) => Math.abs(y - other) * scale < tall).map(([other]) => Math.abs(x - other) * scale));
  return Math.min(...gaps, Infinity) - 4;
}

// The first of the spots that lies over none of the boxes, else the one that covers least of them.
export function leastCovering(spots, boxes) {
  const covered = spots.map((spot) => boxes.reduce((sum, box) => sum + overlap(spot, box), 0));
  return spots[covered.indexOf(Math.min(...covered))];
}

// The middle [x, y] of a label of `size` {wide, tall} for a disc {x, y, radius} on a pad of ± half: above it, below, right
// or left, and farther off if need be, inside of the pad and over none of the boxes.
export function freeSpot(disc, size, boxes, half) {
  const inside = (value, room) => Math.min(Math.max(value, -half + room), half - room);
  const ways = [0, 24, 48].flatMap((farther) => {
    const up = disc.radius + 2 + size.tall / 2 + farther, across = disc.radius + 4 + size.wide / 2 + farther;
    return [[0, -up], [0, up], [across, 0], [-across, 0]];
  });
  const spots = ways.map(([dx, dy]) => ({ x: inside(disc.x + dx, size.wide / 2), y: inside(disc.y + dy, size.tall / 2), ...size }));
  const own = { x: disc.x, y: disc.y, wide: 1.4 * disc.radius, tall: 1.4 * disc.radius };
  const { x, y } = leastCovering(spots, [own, ...boxes]);
  return [x, y];
}
