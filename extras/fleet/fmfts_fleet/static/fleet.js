// The page of the fleet: a card for each robot, with its state in words, and the way to its own view.

import { Link } from "./link.js";
import { setText } from "./readings.js";
import { loadAdvice, withCode, wordsOf } from "./words.js";

const element = (id) => document.getElementById(id);
const OLD_MS = 2000; // four tellings: the page's server stands still, and what it said is no longer known
const SLOW_SHARE = 0.9, UNKNOWN = "not known";
const WORDS = { there: "there", lost: "lost", unreached: "not reached", waiting: "waiting", unknown: UNKNOWN };
const page = { robots: [], cards: new Map(), linkState: "wait", toldMs: -Infinity, openedMs: -Infinity };
const link = new Link();

link.addEventListener("said", ({ detail }) => {
  if (!detail.fleet) return;
  page.robots = detail.fleet;
  page.toldMs = performance.now();
  show();
});

link.addEventListener("state", ({ detail: { state, why } }) => {
  page.linkState = state;
  page.why = why;
  if (state === "open") page.openedMs = performance.now();
  show();
});

// What this page cannot know now is not shown as it was.
function isKnown() {
  return page.linkState === "open" && page.toldMs > page.openedMs && performance.now() - page.toldMs < OLD_MS;
}

function show() {
  const known = isKnown();
  const robots = page.robots.map((robot) => (known ? robot : { ...robot, state: "unknown", why: "", rate_hz: null, health: {}, worst: null }));
  for (const robot of robots) showCard(robot);
  const silent = performance.now() - Math.max(page.toldMs, page.openedMs) >= OLD_MS;
  const text = page.linkState !== "open" ? page.why ?? "" : silent ? "The server of this page says nothing any more. Has somebody stopped `fmfts-daemon view`?" : "";
  element("banner").hidden = !text;
  if (element("banner").textContent !== text.replaceAll("`", "")) withCode(element("banner"), text);
  setText(element("summary"), summary(robots, known));
}

// One sentence, which is read aloud where it changes.
function summary(robots, known) {
  if (!known) return robots.length && page.linkState !== "open" ? "no connection: nothing is known of the robots" : "connecting …";
  const named = (state) => robots.filter((robot) => robot.state === state).map((robot) => robot.name);
  const parts = [`${named("there").length} of ${robots.length} robots there`];
  for (const state of ["lost", "unreached"]) if (named(state).length) parts.push(`${WORDS[state]}: ${named(state).join(", ")}`);
  document.title = `${named("lost").length + named("unreached").length ? `${parts.slice(1).join("; ")}: ` : ""}fmfts`;
  return parts.join("; ");
}

function cardOf(name) {
  let card = page.cards.get(name);
  if (!card) {
    card = element("card").content.firstElementChild.cloneNode(true);
    const way = card.querySelector("a");
    way.textContent = name;
    way.href = `robot/${name}/`;
    const state = card.querySelector(".state");
    state.id = `state-${name}`;
    way.setAttribute("aria-describedby", state.id);
    page.cards.set(name, card);
    element("robots").append(card);
  }
  return card;
}

function showCard(robot) {
  const card = cardOf(robot.name), part = (name) => card.querySelector(`.${name}`);
  card.dataset.state = robot.state;
  setText(part("address"), robot.address);
  setText(card.querySelector(".state b"), WORDS[robot.state]);
  setText(part("since"), sinceWords(robot));
  if (part("why").dataset.text !== robot.why) withCode(part("why"), (part("why").dataset.text = robot.why));
  const isThere = robot.state === "there";
  setText(part("pads"), isThere ? String(robot.pads) : robot.pads ? `${robot.pads} when it was there` : UNKNOWN);
  setText(part("health"), Object.entries(robot.health).map(([health, count]) => `${count} ${health.replace("_", " ")}`).join(", ") || UNKNOWN);
  const slow = isThere && robot.rate_hz < SLOW_SHARE * robot.rate_nominal_hz;
  setText(part("rate"), isThere ? `${robot.rate_hz.toFixed(0)} of ${robot.rate_nominal_hz.toFixed(0)} Hz${slow ? ": too slow" : ""}` : UNKNOWN);
  part("rate").dataset.slow = String(slow);
  showWorst(part("worst"), part("advice"), robot.worst, isThere);
}

function showWorst(place, advice, worst, isThere) {
  const words = worst ? wordsOf(worst, worst, "open") : null;
  setText(place, words ? [`${worst.pad} (${words.word})`, words.reason].filter(Boolean).join(": ") : isThere ? "none: all are well" : UNKNOWN);
  place.dataset.sound = String(!words);
  const help = words?.advice ? `What to do: ${words.advice}` : "";
  if (advice.dataset.text !== help) withCode(advice, (advice.dataset.text = help));
}

function sinceWords({ state, since_s }) {
  if (state === "unknown") return "";
  const when = new Date(Date.now() - (performance.now() - page.toldMs) - since_s * 1e3).toLocaleTimeString("en-GB");
  if (state === "unreached") return `since ${when}: it has not been there since fmfts-daemon view was started`;
  return `since ${when}, ${durationWords(since_s)}`;
}

function durationWords(seconds) {
  if (seconds < 100) return `${Math.floor(seconds)} s`;
  return seconds < 6000 ? `${Math.floor(seconds / 60)} min` : `${Math.floor(seconds / 3600)} h`;
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  setText(element("theme").firstElementChild, theme === "dark" ? "Light" : "Dark");
}

const turnTheme = () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
const wantsDark = matchMedia("(prefers-color-scheme: dark)");
wantsDark.addEventListener("change", () => setTheme(wantsDark.matches ? "dark" : "light"));
element("theme").addEventListener("click", turnTheme);
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key.toLowerCase() === "t") turnTheme();
  else if (/^[1-9]$/.test(event.key)) element("robots").querySelectorAll("a")[Number(event.key) - 1]?.click();
});
window.fmfts = page; // for tests, and for who looks with the browser's tools
setTheme(wantsDark.matches ? "dark" : "light");
await loadAdvice();
setInterval(show, 500);
