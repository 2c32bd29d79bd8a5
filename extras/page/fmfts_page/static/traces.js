// Force, place, residual, age and rate over time (uPlot), with events as marks.

import uPlot from "./vendor/uPlot.esm.js";
import { toneOf } from "./events.js";
import { known, posesOf } from "./numbers.js";
import { colour, font } from "./paint.js";

const force = ({ contact }) => (contact.contact === false ? 0 : contact.over_range ? contact.force_min_n : contact.force_n);
// An edge of the band; without contact there is none, because the deviation is then of what could be felt.
const edge = (row, sign) => (row.contact.contact && known(row.contact.force_n) && known(row.contact.force_sd_n) ? Math.max(force(row) + sign * 2 * row.contact.force_sd_n, 0) : null);
const orNull = (value) => (known(value) ? value : null);
const worst = (values) => (values.length ? Math.max(...values) : null);
const mm = (value) => (known(value) ? value * 1e3 : null);

// Each trace: title, unit, and its lines; `band`: the lines before it are the band's upper and lower edge.
const TRACES = [
  { title: "Force", note: "N; band: two deviations", height: 132, lines: [
    ["upper edge", (row) => edge(row, 1), "band"],
    ["lower edge", (row) => edge(row, -1), "band"],
    ["force", (row) => orNull(force(row)), "contact"],
    ["over range: at least", (row) => (row.contact.over_range ? orNull(row.contact.force_min_n) : null), "bad"],
    ["ghost", null, "ghost"],
  ], least: [0, 0.5] },
  { title: "Place", note: "mm; x solid, y dashed", height: 92, lines: [
    ["x", (row) => mm(row.places[0]?.x_m), "contact"],
    ["y", (row) => mm(row.places[0]?.y_m), "ellipse"],
    ["x of another finger", (row) => mm(row.places[1]?.x_m), "accent"],
    ["y of another finger", (row) => mm(row.places[1]?.y_m), "north"],
  ], least: [-10, 10] },
  { title: "Residual", note: "χ²", height: 92, lines: [["χ²", (row) => orNull(worst(posesOf(row.contact).map((pose) => pose.chi2))), "contact"]], least: [0, 20] },
  { title: "Age when drawn", note: "ms, of the sample", height: 92, lines: [["age", (row) => row.age_ms, "contact"]], rows: "ages", least: [0, 50] },
  { title: "Rate", note: "messages a second", height: 92, lines: [["rate", (row) => orNull(row.rate), "contact"]], least: [0, 240] },
];

export class Traces {
  // clicked(t): a moment in s on the daemon's clock. hovered(t or null).
  constructor(box, { clicked, hovered }) {
    this.box = box;
    this.callbacks = { clicked, hovered };
    this.seconds = 10;
    this.now = 0;
    this.events = [];
    this.plots = TRACES.map((trace) => this.made(trace));
    new ResizeObserver(() => this.resize()).observe(box);
  }

  made(trace) {
    const part = document.createElement("div");
    part.className = "trace";
    const title = document.createElement("h3");
    title.append(trace.title, Object.assign(document.createElement("span"), { textContent: trace.note }));
    part.append(title);
    this.box.append(part);
    const axis = { stroke: () => colour.muted, font: font(10.5), grid: { stroke: () => colour.faint, width: 1 }, ticks: { stroke: () => colour.line, size: 4 } };
    const options = {
      width: 300, height: trace.height, legend: { show: false }, padding: [6, 16, 0, 0],
      scales: { x: { time: false, range: () => [this.now - this.seconds, this.now] }, y: { range: (_, low, high) => rangeOf(trace.least, low, high) } },
      axes: [
        { ...axis, size: 22, gap: 2, splits: () => this.splits(), values: (_, splits) => splits.map((t) => this.ago(t)) },
        { ...axis, size: 38, gap: 2 },
      ],
      cursor: { sync: { key: "time" }, points: { show: false }, drag: { x: false, y: false }, y: false },
      series: [{}, ...trace.lines.map(([name, , tone]) => this.line(name, tone))],
      bands: trace.lines[0][2] === "band" ? [{ series: [1, 2], fill: () => `color-mix(in srgb, ${colour.ellipse} 30%, transparent)` }] : [],
      hooks: { draw: [(plot) => this.drawEvents(plot)], setCursor: [(plot) => this.hover(plot)] },
    };
    const plot = new uPlot(options, [[], ...trace.lines.map(() => [])], part);
    plot.over.addEventListener("click", () => plot.cursor.left >= 0 && this.callbacks.clicked(plot.posToVal(plot.cursor.left, "x")));
    plot.over.addEventListener("mouseleave", () => this.callbacks.hovered(null));
    return { trace, plot };
  }

  line(name, tone) {
    const bare = { points: { show: false }, spanGaps: false };
    if (tone === "band") return { ...bare, label: name, width: 0, stroke: "transparent" };
    const dashed = name === "ghost" ? [4, 4] : name.startsWith("y") ? [6, 4] : undefined;
    return { ...bare, label: name, stroke: () => colour[tone], width: tone === "bad" ? 3 : 1.6, dash: dashed };
  }

  splits() {
    const step = this.seconds <= 10 ? 2 : 120, count = Math.floor(this.seconds / step);
    return Array.from({ length: count + 1 }, (_, i) => this.now - (count - i) * step);
  }

  ago(t) {
    const seconds = Math.round(this.now - t);
    if (seconds === 0) return "now";
    return this.seconds <= 10 ? `−${seconds} s` : `−${seconds / 60} min`;
  }

  // Shows the pad's last seconds up to `now` (s, on the daemon's clock).
  show(pad, now, marked) {
    this.now = now;
    this.marked = marked;
    this.events = pad.events;
    const long = this.seconds > 10, from = now - this.seconds;
    const past = pad.past(), rows = withGaps((long ? past.coarse : past.fine).between(from, now), long ? 2 : 0.3);
    const times = rows.map((row) => row.t);
    for (const { trace, plot } of this.plots) {
      const own = trace.rows === "ages" ? withGaps(past.ages.between(from, now), 0.3) : rows;
      const x = trace.rows === "ages" ? own.map((row) => row.t) : times;
      plot.setData([x, ...trace.lines.map(([name, value]) => (name === "ghost" ? ghostLine(past, x, long) : own.map((row) => (row.gap ? null : value(row)))))]);
    }
  }

  setSeconds(seconds) {
    this.seconds = seconds;
  }

  drawEvents(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    for (const event of this.events) {
      if (event.t < this.now - this.seconds || event.t > this.now) continue;
      const x = plot.valToPos(event.t, "x", true);
      ctx.strokeStyle = ctx.fillStyle = { bad: colour.bad, good: colour.ok, plain: colour.muted }[toneOf(event)];
      ctx.globalAlpha = 0.75;
      ctx.setLineDash(event.kind === "release" ? [2, 4] : []);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.beginPath();
      ctx.moveTo(x - 4, bbox.top);
      ctx.lineTo(x + 4, bbox.top);
      ctx.lineTo(x, bbox.top + 6);
      ctx.fill();
    }
    if (this.marked !== null && this.marked !== undefined) {
      const x = plot.valToPos(this.marked, "x", true);
      ctx.globalAlpha = 1;
      ctx.setLineDash([]);
      ctx.strokeStyle = colour.accent;
      ctx.lineWidth = 2;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }

  hover(plot) {
    if (plot.over.matches(":hover")) this.callbacks.hovered(plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : null);
  }

  resize() {
    for (const { trace, plot } of this.plots) plot.setSize({ width: Math.max(plot.root.parentElement.clientWidth, 80), height: trace.height });
  }

  redraw() {
    for (const { plot } of this.plots) plot.redraw(false, true);
  }
}

// The scale of the values: at least `least`, and a little more than they need.
function rangeOf([low, high], least, most) {
  if (!known(least) || !known(most)) return [low, high];
  const room = 0.08 * (Math.max(most, high) - Math.min(least, low));
  return [least < low ? least - room : low, most > high ? most + room : high];
}

// Where nothing arrived for longer than `seconds`, no line may lead across.
function withGaps(rows, seconds) {
  if (!rows.some((row, number) => number && row.t - rows[number - 1].t > seconds)) return rows;
  return rows.flatMap((row, number) => (number && row.t - rows[number - 1].t > seconds ? [{ t: rows[number - 1].t + 1e-3, gap: true }, row] : [row]));
}

// What the fixed baseline said last before each time, for as long as it goes on saying something.
function ghostLine(past, times, long) {
  const ghosts = long ? [] : past.ghosts.between(times[0] ?? 0, times.at(-1) ?? 0);
  let next = 0;
  return times.map((t) => {
    while (next + 1 < ghosts.length && ghosts[next + 1].t <= t) next++;
    const one = ghosts[next];
    return one && one.t <= t && t - one.t < 0.1 ? orNull(one.ghost.force_n) : null;
  });
}
