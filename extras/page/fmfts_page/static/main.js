// Puts the page together: takes messages in, and draws what is chosen, now or at a moment of the past.

import { listEvent } from "./events.js";
import { Guide } from "./guide.js";
import { Hand } from "./hand.js";
import { Keys } from "./keys.js";
import { Link } from "./link.js";
import { asJson, sentence } from "./numbers.js";
import { PadState } from "./pads.js";
import { readColours } from "./paint.js";
import { setText, showReadings } from "./readings.js";
import { playedByDaemon, Replays } from "./replays.js";
import { sayRobot } from "./robot.js";
import { drawLens, drawSection } from "./section.js";
import { drawTop } from "./top.js";
import { Traces } from "./traces.js";
import { loadAdvice, toast, withCode, wordsOf } from "./words.js";

const element = (id) => document.getElementById(id);
const TRACE_MS = 80, SLOW_MS = 1000, SCHEMA = 1, FEW_PICTURES = 30;

const page = {
  pads: new Map(), chosen: null, paused: null, // paused: the moment in s on the daemon's clock
  linkState: "wait", dirty: true, clockMs: null, pictures: [], drawnMs: 0,
};

const link = new Link();
const hand = new Hand(element("hand-drawing"), element("hand-pads"), choose);
const traces = new Traces(element("traces"), { clicked: copyMoment, hovered: look });
const guide = new Guide(link, element("guide"));
const replays = new Replays(link, element("recordings"), element("record"), switched);
page.traces = traces;

function padNamed(name) {
  let pad = page.pads.get(name);
  if (!pad) {
    pad = new PadState(name);
    page.pads.set(name, pad);
    if (page.chosen === null) choose(name);
    askShapes();
  }
  return pad;
}

// Where sensors and pads are, the daemon tells on its control socket; asked again for a new pad, and after a restart.
async function askShapes() {
  if (replays.shown || askShapes.asked) return;
  askShapes.asked = true;
  try {
    setShapes((await link.request("read", { verb: "pads" })).done.pads);
  } catch {
    setTimeout(askShapes, 1000); // the daemon does not answer yet; the page says so in words
  }
  askShapes.asked = false;
}

function setShapes(shapes) {
  for (const shape of shapes) {
    const pad = padNamed(shape.pad);
    pad.shape = { ...pad.shape, ...shape };
  }
  const all = [...page.pads.values()];
  element("hand").hidden = all.length < 2;
  element("stage").classList.toggle("several", all.length > 1);
  hand.setPads(all);
  page.dirty = true;
}

function choose(name) {
  if (!page.pads.has(name)) return;
  page.chosen = name;
  link.watch({ detail: name });
  setText(element("pad-name"), `Pad ${name}`);
  page.dirty = true;
}

link.addEventListener("message", ({ detail: { topic, body } }) => {
  if (topic === "clock") return void (page.clockMs = { at: performance.now(), ms: Number(body.now_ns) / 1e6 });
  if (topic === "replayed") return replayed(body.why);
  const [kind, name] = topic.split("/");
  if (kind === "caption") return caption(body.text);
  if (kind !== "ghost" && body.v !== SCHEMA) {
    banner(`The daemon speaks version ${body.v} of the messages, this page ${SCHEMA}: install both of one version.`);
    return;
  }
  const pad = padNamed(name), boot = pad.contact?.boot;
  if (kind === "contact") {
    pad.takeContact(body);
    if (boot !== undefined && boot !== body.boot) askShapes();
  } else if (kind === "status") pad.status = body;
  else if (kind === "event") {
    pad.takeEvent(body);
    listEvent(element("event-list"), pad.events.at(-1), page.pads.size > 1);
  } else if (kind === "ghost") {
    pad.takeGhost(body);
    element("legend-ghost").hidden = false;
  }
  page.dirty = true;
});

link.addEventListener("state", ({ detail: { state, why } }) => {
  page.linkState = state;
  banner(why);
  page.dirty = true;
});

link.addEventListener("said", ({ detail }) => {
  page.leftOut = detail.left_out ?? page.leftOut;
});

function caption(text) {
  element("caption").hidden = !text;
  setText(element("caption"), text);
}

function banner(text) {
  element("banner").hidden = !text;
  setText(element("banner"), text);
}

// Milliseconds on the clock of the messages: the daemon's, or that of the recording that is shown.
function nowMs() {
  if (replays.shown) return page.clockMs ? page.clockMs.ms + (performance.now() - page.clockMs.at) : null;
  return link.daemonMs();
}

function switched(shapes) {
  const chosen = page.chosen;
  if (page.paused !== null) pause(false);
  page.pads.clear();
  page.chosen = page.paused = page.clockMs = null;
  element("event-list").replaceChildren();
  element("legend-ghost").hidden = true;
  if (shapes) setShapes(shapes);
  else askShapes();
  choose(chosen);
}

// At its end a recording stands still, so that its last ten seconds can be looked at.
function replayed(why) {
  replays.ended(why);
  if (page.paused === null) pause(true);
}

// What is drawn of a pad: the newest contact, or while paused the one of the moment.
function contactOf(pad) {
  return page.paused === null ? pad.shown() : pad.at(page.paused);
}

function draw() {
  requestAnimationFrame(draw);
  const now = performance.now(), pad = page.pads.get(page.chosen);
  const stale = pad && pad.silent() !== page.wasSilent;
  if (page.dirty || stale) {
    page.dirty = false;
    page.wasSilent = pad?.silent();
    page.pictures.push(now);
    if (!element("hand").hidden) hand.draw(page.chosen, contactOf);
    if (pad) drawPadNow(pad);
    showWords(pad);
  }
  while (page.pictures.length && page.pictures[0] < now - 2000) page.pictures.shift();
  if (pad && now - page.drawnMs > TRACE_MS) {
    page.drawnMs = now;
    drawTraces(pad);
  }
}

function drawPadNow(pad) {
  const contact = contactOf(pad), clock = nowMs();
  const ageMs = contact && clock !== null && page.paused === null && contact.t_sample_ns > 0 ? clock - Number(contact.t_sample_ns) / 1e6 : null;
  if (ageMs !== null && !replays.shown) pad.ages.push({ t: clock / 1e3, age_ms: ageMs });
  drawTop(element("top"), pad, contact);
  drawSection(element("section"), pad, contact);
  const lens = drawLens(element("lens"), pad, contact);
  setText(element("lens-scale"), `from rest; circle ± ${(lens * 1e3).toLocaleString("en")} mm`);
  showReadings(pad, contact, replays.shown ? null : ageMs);
}

function drawTraces(pad) {
  const clock = nowMs();
  const now = page.paused ?? (clock === null ? pad.fine.rows.at(-1)?.t ?? 0 : clock / 1e3);
  traces.show(pad, page.paused === null ? now : page.pausedAt, page.paused);
}

function showWords(pad) {
  const status = pad && { ...pad.status, everArrived: pad.contact !== null };
  const words = wordsOf(pad && contactOf(pad), status, page.linkState, replays);
  const key = JSON.stringify(words);
  if (key === page.words) return;
  page.words = key;
  const health = element("health");
  health.dataset.health = words.health;
  setText(health.lastElementChild, words.word);
  withCode(element("reason"), words.reason);
  withCode(element("advice"), words.advice ? `What to do: ${words.advice}` : "");
}

// Once a second: text alternatives, the chip at the top, and how many pictures were drawn.
setInterval(() => {
  const pad = page.pads.get(page.chosen);
  const said = pad ? sentence(contactOf(pad)) : "nothing arrives";
  for (const id of ["top", "section", "lens"]) element(id).setAttribute("aria-label", `${id === "top" ? "from above" : id === "section" ? "section" : "magnet, enlarged"}: ${said}`);
  hand.describe(page.chosen, contactOf);
  replays.say(page.paused === null ? page.clockMs?.ms ?? null : page.paused * 1e3);
  for (const id of ["record", "first-use"]) element(id).hidden = replays.shown !== null && !(id === "record" && replays.under_way);
  const words = `${pad?.name ?? ""} ${pad?.contact?.health ?? ""}`;
  if (words !== page.saidWords) setText(element("said"), `pad ${words.replace("_", " ")}`);
  page.saidWords = words;
  const arriving = pad && !pad.silent(), pictures = Math.round(page.pictures.length / 2);
  page.picturesPerSecond = pictures;
  const slow = arriving && pictures < FEW_PICTURES && page.paused === null && !document.hidden && (pad.rate() ?? 0) > FEW_PICTURES + 10;
  const chip = element("link");
  const played = playedByDaemon(pad?.status);
  const state = page.linkState !== "open" ? "gone" : page.paused !== null ? "paused" : replays.shown || (played && arriving) ? "replay" : arriving ? "live" : "wait";
  chip.dataset.state = state;
  const word = { gone: "no connection", paused: "paused", replay: `replay of ${replays.shown ?? `${played} by the daemon`}`, live: "live", wait: "waiting for messages" }[state];
  setText(chip, `${word}${state === "live" ? `, ${pictures} pictures a second` : ""}${slow ? ": this computer shows less often" : ""}${page.leftOut ? `; ${page.leftOut} messages left out` : ""}`);
  page.dirty = true;
}, SLOW_MS);

function pause(on = page.paused === null) {
  const clock = nowMs();
  if (on && clock === null) return;
  page.paused = page.pausedAt = on ? clock / 1e3 : null;
  for (const pad of page.pads.values()) pad.freeze(on);
  element("pause").setAttribute("aria-pressed", String(on));
  element("pause").firstElementChild.textContent = on ? "Go on" : "Pause";
  setText(element("moment"), "");
  page.dirty = true;
}

// While paused: the moment under the pointer.
function look(t) {
  if (page.paused === null || t === null) return;
  moveTo(t);
}

function moveTo(t) {
  page.paused = Math.min(Math.max(t, page.pausedAt - traces.seconds), page.pausedAt);
  setText(element("moment"), page.paused < page.pausedAt ? `${(page.pausedAt - page.paused).toFixed(2)} s before the pause` : "");
  page.dirty = true;
}

function step(messages, seconds) {
  const pad = page.pads.get(page.chosen);
  if (page.paused === null || !pad) return;
  if (seconds) return moveTo(page.paused + seconds);
  const { fine } = pad.past(), { rows } = fine, index = Math.min(fine.at(page.paused), rows.length - 1);
  const row = rows[Math.min(Math.max(index + messages, fine.begin), rows.length - 1)];
  if (row) moveTo(row.t);
}

async function copyMoment(t) {
  const pad = page.pads.get(page.chosen);
  const contact = pad?.at(t);
  if (!contact) return;
  page.copied = asJson(contact);
  try {
    await navigator.clipboard.writeText(page.copied);
    toast(`copied message ${contact.seq} of ${pad.name} as JSON`);
  } catch {
    toast("the browser does not let this page copy: allow it, or use `fmfts-daemon listen --json`");
  }
}

function setSeconds(seconds) {
  traces.setSeconds(seconds);
  element("short").setAttribute("aria-pressed", String(seconds === 10));
  element("long").setAttribute("aria-pressed", String(seconds !== 10));
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  element("theme").firstElementChild.textContent = theme === "dark" ? "Light" : "Dark";
  readColours();
  traces.redraw();
  page.dirty = true;
}

const wantsDark = matchMedia("(prefers-color-scheme: dark)");
wantsDark.addEventListener("change", () => setTheme(wantsDark.matches ? "dark" : "light"));
const actions = {
  pause: () => pause(), record: () => replays.toggle(), replays: () => replays.open(), help: () => element("keys").showModal(),
  guide: () => replays.shown === null && guide.open([...page.pads.keys()], page.chosen), theme: () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  copy: () => copyMoment(page.paused ?? (nowMs() ?? 0) / 1e3), step, pad: (number) => choose([...page.pads.keys()][number]),
  seconds: (seconds = traces.seconds === 10 ? 600 : 10) => setSeconds(seconds),
};
new Keys(actions);
Object.assign(page, { nowMs, link });
window.fmfts = page; // for tests, and for who looks with the browser's tools
setTheme(wantsDark.matches ? "dark" : "light");
sayRobot();
new ResizeObserver(() => (page.dirty = true)).observe(element("stage"));
await loadAdvice();
askShapes();
requestAnimationFrame(draw);
