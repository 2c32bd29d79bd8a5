// The list of events beside the traces, the newest first.

const MARKS = { onset: "▼", release: "△", baseline: "■" }, TONES = { bad: "▲", good: "●" }, MOST = 200;

// "bad", "good" or "plain": "health ok" is the end of what was wrong, and "health ok: …" news of a pad that is well.
export function toneOf({ kind, detail }) {
  if (kind === "over_range" || kind === "rejected") return "bad";
  if (kind !== "health" || detail.startsWith("ok:")) return "plain";
  return detail === "ok" ? "good" : "bad";
}

// named: there are several pads, so the line says which.
export function listEvent(list, event, named) {
  const line = document.createElement("li"), mark = document.createElement("i"), text = document.createElement("span"), when = document.createElement("time");
  line.dataset.kind = event.kind;
  line.dataset.tone = toneOf(event);
  mark.textContent = TONES[line.dataset.tone] ?? MARKS[event.kind] ?? "·";
  const kind = ["overload", "rejected"].includes(event.kind) ? "" : event.kind.replace("_", " "); // their texts say what happened
  text.textContent = [named ? `${event.pad}:` : "", kind, event.detail].filter(Boolean).join(" ");
  when.textContent = new Date().toLocaleTimeString("en-GB");
  line.append(mark, text, when);
  list.prepend(line);
  while (list.children.length > MOST) list.lastElementChild.remove();
}
