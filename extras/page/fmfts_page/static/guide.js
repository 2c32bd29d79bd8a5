// First use as cards: each says what to do with one's hands, runs its verb, and shows what was found.

import { shown, shownDeviation } from "./numbers.js";
import { withCode } from "./words.js";

const STANDARD_GRAVITY_M_PER_S2 = 9.80665;
const STEPS = [
  { key: "probe", title: "Is everything there?", ask: "read", rest: { verb: "probe" }, hands: "Connect the board. Nothing else to do.",
    icon: [["M9 22h10M31 22h8", 1], ["M19 14h12v16H19z"], ["M22 18v.1M28 18v.1M22 26v.1M28 26v.1", 1]] },
  { key: "selftest", title: "Measure every axis", ask: "selftest", hands: "Leave the pad alone for two seconds: each chip makes a field of its own, so that its gains are measured.",
    icon: [["M14 14h20v20H14z"], ["M24 28V18m-4 4 4-4 4 4", 1], ["M10 18h4M10 24h4M10 30h4M34 18h4M34 24h4M34 30h4"]] },
  { key: "bare", title: "The field without the pad", ask: "baseline", rest: { kind: "bare" }, hands: "Take the silicone pad off the sensors and put it half a metre away. Hold still for three seconds.",
    icon: [["M8 36h32"], ["M13 31h5v5h-5zM30 31h5v5h-5z"], ["M12 17c6-5 18-5 24 0M16 23c4-3 12-3 16 0", 1]] },
  { key: "rest", title: "The pad at rest", ask: "baseline", rest: { kind: "rest" }, hands: "Mount the pad. Touch nothing for three seconds.",
    icon: [["M8 36h32"], ["M13 31h5v5h-5zM30 31h5v5h-5z"], ["M9 20h30v7H9z", 1], ["M22 21.500h4v4h-4z"]] },
  { key: "turn", title: "Turn the robot", ask: "baseline", rest: { kind: "turn" }, hands: "Untouched, turn the whole hand slowly about all three axes, for about 20 seconds. It ends by itself when it has seen enough.",
    icon: [["M17 20h14v9H17z"], ["M12 30c-6-10 2-20 12-20M36 18c6 10-2 20-12 20", 1], ["M20 7l4 3-4 3M28 35l-4 3 4 3", 1]] },
  { key: "refine", title: "Press some thirty times", ask: "baseline", rest: { kind: "refine" }, hands: "Press with a finger, firmly and lightly, all over the pad. It says where it has seen too little.",
    icon: [["M9 30h30v7H9z"], ["M24 8v15m-5-5 5 5 5-5", 1], ["M14 33.500h2M23 33.500h2M32 33.500h2"]] },
  { key: "weigh", title: "Put a known weight on it", ask: "weigh", hands: "Lay the pad level. Put 50 to 150 g on a coin, a ball or a small cylinder in its middle, nothing of iron. Let go, and wait ten seconds.",
    numbers: [{ key: "weight_n", words: "weight, g", value: 100, most: 1000, unit: STANDARD_GRAVITY_M_PER_S2 * 1e-3 }, { key: "width_m", words: "width of what touches the pad, mm", value: 10, most: 15, unit: 1e-3 }],
    icon: [["M9 31h30v6H9z"], ["M19 25h10v6H19z"], ["M17 11h14v14H17z", 1], ["M21 18h6", 1]] },
  { key: "posture", title: "Move the fingers", ask: "baseline", rest: { kind: "posture" }, hands: "Only for a pad with ambient = \"posture\", while joint positions are published: move the untouched hand through all its postures for a minute.",
    icon: [["M14 38v-10l6-8M20 20l4-10", 1], ["M26 38v-12l6-6M32 20l2-9"], ["M10 38h24"]] },
];

// What a person gets from a step: fact, words, factor, unit. The last two are what `turn` and `refine` measure.
const PRESS = [["middle_1n_place_sd_m", "place of a press of 1 N in the middle", 1e3, "mm"], ["middle_1n_force_sd_n", "its force", 1, "N"]];
const MEASURED = { turn: ["gain_sd", "gains of the sensors", 1e2, "%"], refine: ["sensor_place_sd_m", "places of the sensors", 1e3, "mm"] };

export class Guide {
  constructor(link, dialog) {
    this.link = link;
    this.dialog = dialog;
    this.select = dialog.querySelector("select");
    this.cards = STEPS.map((step, number) => this.card(step, number));
    dialog.querySelector("#cards").append(...this.cards.map((card) => card.box));
    this.select.addEventListener("change", () => this.cards.forEach((card) => this.reset(card)));
  }

  open(pads, chosen) {
    this.select.replaceChildren(...pads.map((name) => Object.assign(document.createElement("option"), { value: name, textContent: name, selected: name === chosen })));
    this.dialog.show();
    (this.cards.find((card) => card.box.dataset.state !== "done") ?? this.cards[0]).button.focus();
  }

  card(step, number) {
    const box = document.createElement("li");
    box.append(icon(step.icon), node("h3", `${number + 1}. ${step.title}`));
    const button = node("button", "Start");
    button.setAttribute("aria-label", `Start step ${number + 1}: ${step.title}`);
    const result = node("div", "");
    result.className = "result";
    result.setAttribute("aria-live", "polite");
    const numbers = (step.numbers ?? []).map((one) => [one, numberInput(one)]);
    const fields = numbers.map(([one, input]) => {
      const field = node("label", `${one.words} `);
      field.append(input);
      return field;
    });
    box.append(button, node("p", step.hands), ...fields, result);
    const card = { step, box, button, result, numbers };
    button.addEventListener("click", () => this.run(card));
    return card;
  }

  reset(card) {
    delete card.box.dataset.state;
    card.button.textContent = "Start";
    card.result.replaceChildren();
  }

  async run(card) {
    const { step, box, button, result } = card, pad = this.select.value;
    box.dataset.state = "running";
    for (const other of this.cards) other.button.disabled = true;
    const bar = document.createElement("progress"), hint = node("p", "");
    bar.max = 1;
    bar.setAttribute("aria-label", `progress of ${step.title}`);
    hint.className = "hint";
    result.replaceChildren(hint, bar);
    const numbers = Object.fromEntries(card.numbers.map(([one, input]) => [one.key, input.valueAsNumber * one.unit]));
    const rest = step.ask === "read" ? step.rest : { ...step.rest, ...numbers, pad };
    try {
      const wrong = card.numbers.find(([, input]) => !input.checkValidity());
      if (wrong) throw new Error(`${wrong[0].words}: more than 0, up to ${wrong[0].most}.`);
      const { done, lines } = await this.link.request(step.ask, rest, (progress) => {
        bar.value = progress.share ?? 0;
        hint.textContent = progress.hint ?? "";
      });
      const fault = faultOf(step, done, pad);
      box.dataset.state = fault ? "refused" : "done";
      result.replaceChildren(...(fault ? [said("error", fault)] : []), ...found(step, done, pad, lines));
    } catch (error) {
      box.dataset.state = "refused";
      result.replaceChildren(said("error", error.message));
    }
    for (const other of this.cards) other.button.disabled = false;
    button.textContent = "Again";
    const next = this.cards[this.cards.indexOf(card) + 1];
    (box.dataset.state === "done" && next ? next.button : button).focus();
  }
}

// Why a verb that was carried out did not end well; "" where it did.
function faultOf(step, facts, pad) {
  if (step.key === "selftest" && facts.passed === false) return "Some sensor failed: see below; check its supply and wires, then do it again.";
  const probed = step.key === "probe" && facts.pads.find((one) => one.pad === pad);
  if (step.key === "probe" && !probed) return `The daemon has no pad ${pad}.`;
  if (probed && !probed.connected) return `The source of ${pad} does not answer: plug it in, then do it again.`;
  if (probed && !probed.sound) return "It answers, but something is wrong: see below.";
  return "";
}

// The result: what a press of 1 N is now known to, what else could be gained, and all facts as the terminal prints them.
function found(step, facts, pad, lines) {
  const parts = [node("p", headline(step, facts, pad))];
  const now = (name) => facts[`now_${name}`], was = (name) => facts[`was_${name}`];
  const tiles = [...PRESS, ...(step.key in MEASURED ? [MEASURED[step.key]] : [])].filter(([name]) => now(name) !== undefined);
  if (tiles.length) {
    const box = document.createElement("div");
    box.className = "gains";
    for (const [name, what, factor, unit] of tiles) {
      const tile = node("div", `${what}; was ± ${shownDeviation(was(name) * factor)}`);
      tile.prepend(node("b", `± ${shownDeviation(now(name) * factor)} ${unit}`));
      box.append(tile);
    }
    parts.push(box);
  }
  for (const warning of facts.warnings ?? []) parts.push(said("error", `${warning[0].toUpperCase()}${warning.slice(1)}.`));
  for (const gain of facts.could_gain ?? []) parts.push(said("", gain.replace("selftest:", "Step 2 would bring the magnet's way").replace("--turn:", "Step 5 would bring the magnet's way").replace("--refine:", "Step 6 would bring the magnet's way")));
  const details = document.createElement("details"), text = node("div", lines.join("\n"));
  text.className = "lines";
  details.append(node("summary", "All that was found"), text);
  return [...parts, details];
}

function headline(step, facts, pad) {
  if (step.key === "probe") {
    const one = facts.pads.find((each) => each.pad === pad);
    return one ? `${one.source}${one.sound ? ": sound" : ""}` : "";
  }
  if (step.key === "selftest") return facts.passed ? "Every axis answers. The gains are stored for the next baseline." : "";
  if (step.key === "weigh") return `The silicone is ${shown(facts.stiffness, 2)} ± ${shownDeviation(facts.stiffness_sd)} times as stiff as the contact model's. All forces and their deviations use it from now on.`;
  const parts = [`Baseline ${facts.baseline}`];
  if (facts.remanence_t !== undefined) parts.push(`magnet ${shown(facts.remanence_t, 3)} ± ${shown(facts.remanence_sd_t, 3)} T`);
  if (facts.rest_position_m) parts.push(`at rest at ${facts.rest_position_m.map((value) => shown(value * 1e3, 2)).join(", ")} mm`);
  if (facts.noise_t !== undefined) parts.push(`noise ${shown(facts.noise_t * 1e6, 2)} µT`);
  return `${parts.join("; ")}.`;
}

function numberInput({ value, most }) {
  return Object.assign(document.createElement("input"), { type: "number", value, min: "0.1", max: most, step: "any", required: true });
}

function said(kind, text) {
  const line = document.createElement("p");
  line.className = kind;
  withCode(line, text);
  return line;
}

function node(tag, text) {
  return Object.assign(document.createElement(tag), { textContent: text });
}

function icon(paths) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 48 48");
  svg.setAttribute("aria-hidden", "true");
  for (const [d, on] of paths) {
    const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    path.setAttribute("d", d);
    if (on) path.setAttribute("class", "on");
    svg.append(path);
  }
  return svg;
}
