// What the page knows of each pad: its shape, its newest messages, and what was before.

import { touchesOf } from "./numbers.js";

const FINE_S = 13, COARSE_S = 610, BIN_S = 0.2, RATE_S = 1.0, SLID_S = 5, MOST_EVENTS = 400;
const NOBODY = Symbol("nobody"); // no finger's id: that of a contact is undefined
export const SILENT_S = 0.3; // three messages: the daemon sends ten a second, also while the hardware is silent

const hardness = ({ contact }) => (contact.over_range ? Infinity : contact.contact ? contact.force_n ?? 0 : 0);
const DRAWING = { sensors_m: [], rest_position_m: [0, 0, 0.012], rest_axis: [0, 0, 1], magnet_diameter_m: 0.002, magnet_length_m: 0.002 };

// Rows in the order of time; the oldest go. Rows are shared with copies and other views, so nobody changes one.
class Rows {
  constructor(seconds) {
    this.seconds = seconds;
    this.rows = [];
    this.begin = 0;
  }

  push(row) {
    this.rows.push(row);
    while (this.rows[this.begin].t < row.t - this.seconds) this.begin++;
    if (this.begin > 2000) {
      this.rows.splice(0, this.begin);
      this.begin = 0;
    }
  }

  replaceLast(row) {
    this.rows[this.rows.length - 1] = row;
  }

  // Index of the first row at `t` or later.
  at(t) {
    let low = this.begin, high = this.rows.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.rows[middle].t < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  between(from, to) {
    return this.rows.slice(Math.max(this.begin, this.at(from) - 1), this.at(to) + 1);
  }

  copy() {
    const copied = new Rows(this.seconds);
    copied.rows = this.rows.slice(this.begin);
    return copied;
  }

  clear() {
    this.rows = [];
    this.begin = 0;
  }
}

export class PadState {
  constructor(name) {
    this.name = name;
    this.shape = DRAWING;
    this.contact = this.status = this.ghost = null;
    this.arrived = -Infinity; // performance.now() in s
    this.fine = new Rows(FINE_S);
    this.coarse = new Rows(COARSE_S);
    this.binFrom = -Infinity;
    this.ghosts = new Rows(FINE_S);
    this.ages = new Rows(FINE_S);
    this.events = [];
    this.lost = 0;
    this.trail = []; // [t, x, y, finger]
    this.slid = []; // [t, x, y, slips]: where the finger slipped, and once where it stuck again
    this.columns = [NOBODY, NOBODY]; // ids of fingers
    this.sent = []; // {t, seq} of the last second
    this.frozen = null;
  }

  takeContact(contact) {
    const before = this.contact;
    const t = Number(contact.t_publish_ns) / 1e9;
    if (before && (before.boot !== contact.boot || t < Number(before.t_publish_ns) / 1e9)) this.forget();
    this.contact = contact;
    this.arrived = performance.now() / 1e3;
    this.sent.push({ t, seq: Number(contact.seq) });
    while (this.sent[0].t < t - RATE_S) this.sent.shift();
    const touches = touchesOf(contact);
    const row = { t, contact, rate: this.rate(), places: this.inColumns(touches) };
    this.fine.push(row);
    this.bin(row);
    for (const { id, x_m, y_m } of touches) this.trail.push([t, x_m, y_m, id]);
    while (this.trail.length && (this.trail[0][0] < t - 0.8 || !contact.contact)) this.trail.shift();
    const slips = contact.slip?.slipping === true;
    if (touches.length === 1 && (slips || this.slid.at(-1)?.[3])) this.slid.push([t, touches[0].x_m, touches[0].y_m, slips]);
    while (this.slid.length && (this.slid[0][0] < t - SLID_S || !contact.contact)) this.slid.shift();
  }

  // Two places, for the traces: a finger stays in one for as long as it touches.
  inColumns(touches) {
    const stay = this.columns.map((id) => touches.find((touch) => touch.id === id) ?? null);
    for (const touch of touches) if (!stay.includes(touch) && stay.includes(null)) stay[stay.indexOf(null)] = touch;
    this.columns = stay.map((touch) => (touch ? touch.id : NOBODY));
    return stay;
  }

  // One row each BIN_S for the long view: the hardest touch of that time, at its own moment.
  bin(row) {
    if (row.t - this.binFrom >= BIN_S) {
      this.binFrom = row.t;
      this.coarse.push(row);
    } else if (hardness(row) > hardness(this.coarse.rows.at(-1))) this.coarse.replaceLast(row);
  }

  takeGhost(ghost) {
    this.ghost = ghost;
    this.ghosts.push({ t: Number(ghost.t_sample_ns) / 1e9, ghost });
  }

  takeEvent(event) {
    this.events.push({ t: Number(event.t_ns) / 1e9, kind: event.kind, detail: event.detail, pad: this.name });
    if (this.events.length > MOST_EVENTS) this.events.shift();
  }

  // Messages a second that the daemon sent, whether this page asked for all of them or not.
  rate() {
    const first = this.sent[0], last = this.sent.at(-1);
    return !first || last.t <= first.t ? null : (last.seq - first.seq) / (last.t - first.t);
  }

  silent() {
    return performance.now() / 1e3 - this.arrived > SILENT_S;
  }

  // After a restart of the daemon its clock and numbers may begin again.
  forget() {
    for (const rows of [this.fine, this.coarse, this.ghosts, this.ages]) rows.clear();
    this.binFrom = -Infinity;
    this.trail = [];
    this.slid = [];
    this.sent = [];
    this.events = [];
  }

  // While the page is paused, what was before stays, though messages go on arriving.
  freeze(on) {
    this.frozen = on ? { fine: this.fine.copy(), coarse: this.coarse.copy(), ghosts: this.ghosts.copy(), ages: this.ages.copy() } : null;
  }

  // The rows to look at: those of the pause, else those that arrive.
  past() {
    return this.frozen ?? this;
  }

  // The message of a moment in the past: the first at `t` or later, of the long view's rows where there are no others.
  at(t) {
    const { fine, coarse } = this.past(), rows = t >= fine.rows[fine.begin]?.t ? fine : coarse;
    return rows.rows[Math.min(rows.at(t), rows.rows.length - 1)]?.contact ?? null;
  }

  // What is to be drawn: the newest contact, or nothing where nothing arrives any more.
  shown() {
    return this.silent() ? null : this.contact;
  }
}

// The state of each sensor in words: "good", "left out", "saturated", "silent" or "not known".
export function sensorStates(contact, status, count) {
  return Array.from({ length: count }, (_, sensor) => {
    if (!contact || ["stale", "disconnected"].includes(contact.health)) return "not known";
    if (contact.sensors_ok & (1 << sensor)) return "good";
    const said = [contact.reason, ...(status?.sensor_faults ?? [])].filter((text) => text.includes(`sensor ${sensor + 1} `));
    if (said.some((text) => new RegExp(`sensor ${sensor + 1} is saturated`).test(text))) return "saturated";
    if (said.some((text) => new RegExp(`sensor ${sensor + 1} (is silent|\\(.*\\) (does not answer|answers but|cannot be reached))`).test(text))) return "silent";
    return "left out";
  });
}
