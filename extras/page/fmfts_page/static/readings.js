// The newest numbers as text: force, place, sensors, and facts of the pad.

import { atMost, fingersText, forceText, known, placeText, posesOf, shown, touchOf, withDeviation } from "./numbers.js";
import { sensorStates } from "./pads.js";
import { slipWords } from "./shear.js";

const element = (id) => document.getElementById(id);
const DEGREES = 180 / Math.PI;

// Sets text only where it changed: the page stays still, and the browser need not lay it out again.
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function setData(node, name, value) {
  if (node.dataset[name] !== value) node.dataset[name] = value;
}

export function showReadings(pad, contact, ageMs) {
  const touch = touchOf(contact), force = element("force");
  const [value, deviation] = forceText(contact).split(" ± ");
  setData(force, "kind", touch === "over" ? "over" : touch === "touch" && known(contact.force_n) ? "touch" : touch === "none" ? "none" : "unknown");
  setText(force.firstElementChild, deviation ? `${value} ± ${deviation}` : value);
  showBar(pad, contact, touch);
  setText(element("place"), touch === "touch" || touch === "over" ? placeWords(contact) : touch === "none" ? atMost(contact, "anywhere on the pad") : "not known is not zero");
  showSensors(pad, contact);
  showFacts(pad, contact, ageMs);
}

function placeWords(contact) {
  if (fingersText(contact)) return fingersText(contact);
  if (!placeText(contact)) return "place not known";
  const shear = known(contact.shear_x_n) ? `; shear ${shown(contact.shear_x_n, 2)}, ${shown(contact.shear_y_n, 2)} N` : "";
  return `x ${withDeviation(contact.x_m, contact.x_sd_m, "mm", 1, 1e3)}, y ${withDeviation(contact.y_m, contact.y_sd_m, "mm", 1, 1e3)}${shear}${slipWords(contact)}`;
}

function showBar(pad, contact, touch) {
  const bar = element("force-bar"), most = pad.shape.calibrated_force_n ?? 2;
  bar.className = touch === "over" ? "over" : touch === "unknown" || (touch === "touch" && !known(contact.force_n)) ? "unknown" : "";
  const force = touch === "touch" && known(contact.force_n) ? contact.force_n : 0, spread = touch === "touch" ? contact.force_sd_n ?? 0 : 0;
  const share = (newton) => `${(100 * Math.min(Math.max(newton / most, 0), 1)).toFixed(1)}%`;
  bar.children[0].style.width = share(force);
  bar.children[1].style.left = share(force - 2 * spread);
  bar.children[1].style.right = `${100 - parseFloat(share(force + 2 * spread))}%`;
  bar.children[1].style.visibility = force > 0 ? "visible" : "hidden";
}

function showSensors(pad, contact) {
  const list = element("sensors"), states = sensorStates(contact, pad.status, pad.shape.sensors_m.length);
  while (list.children.length > states.length) list.lastElementChild.remove();
  while (list.children.length < states.length) list.append(document.createElement("li"));
  states.forEach((state, number) => {
    setData(list.children[number], "state", state);
    setText(list.children[number], `${number + 1} ${state}`);
  });
}

// One magnet's figure, or those of several with their unit once. A figure stays on one line with its deviation.
const ofEach = (poses, unit, words) => (poses.length ? `${poses.map((pose) => words(pose).replaceAll(" ", "\u00a0")).join(", ")}${unit}` : "not known");

function showFacts(pad, contact, ageMs) {
  const { status } = pad, poses = posesOf(contact), [pose] = poses, contactsHz = pad.rate();
  const nominalHz = pad.shape.rate_nominal_hz ?? status?.rate_nominal_hz ?? 0;
  // With publish = "sample" there are more contacts than frames.
  const rate = contactsHz > 1.5 * nominalHz && known(status?.rate_hz) ? status.rate_hz : contactsHz;
  const ambient = pose?.ambient_t;
  const facts = {
    Magnet: ofEach(poses, "\u00a0T", (each) => `${shown(each.remanence_t, 3)} ± ${shown(each.remanence_sd_t, 3)}`),
    Tilt: ofEach(poses, "°", ({ axis: [x, y, z], axis_sd_rad: sd }) => `${shown(Math.atan2(Math.hypot(x, y), Math.abs(z)) * DEGREES, 1)} ± ${shown(sd * DEGREES, 1)}`),
    "Field on top": ambient ? `${shown(Math.hypot(...ambient) * 1e6, 0)} µT` : "–",
    Temperature: known(contact?.temperature_c) ? `${shown(contact.temperature_c, 1)} °C` : "–",
    Rate: rate === null ? "–" : `${shown(rate, 0)} of ${shown(nominalHz, 0)} Hz`,
    "Age when drawn": ageMs === null ? "–" : `${shown(ageMs, 0)} ms`,
    "Sample to bus": known(status?.latency_p50_s) ? `${shown(status.latency_p50_s * 1e3, 1)} ms, p99 ${shown(status.latency_p99_s * 1e3, 1)}` : "–",
    Lost: status ? `${status.gaps} frames, ${status.crc_errors} CRC` : "–",
    Baseline: contact?.baseline ? `${contact.baseline}${status?.gains_from ? `, ${status.gains_from}` : ""}` : "none",
  };
  element("readings").classList.toggle("magnets", poses.length > 1);
  const list = element("facts");
  if (!list.children.length) {
    for (const name of Object.keys(facts)) list.append(Object.assign(document.createElement("dt"), { textContent: name }), document.createElement("dd"));
  }
  Object.values(facts).forEach((text, number) => {
    const cell = list.children[2 * number + 1];
    setText(cell, text);
    if (cell.title !== text) cell.title = text;
  });
}
