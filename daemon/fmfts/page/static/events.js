// The list of events beside the traces, the newest first.

const MARKS = { onset: "▼", release: "△", health: "▲", over_range: "▲", baseline: "■" }, MOST = 200;

// named: there are several pads, so the line says which.
export function listEvent(list, event, named) {
  const line = document.createElement("li"), mark = document.createElement("i"), text = document.createElement("span"), when = document.createElement("time");
  line.dataset.kind = event.kind;
  mark.textContent = MARKS[event.kind] ?? "·";
  text.textContent = `${named ? `${event.pad}: ` : ""}${event.kind.replace("_", " ")}${event.detail ? ` ${event.detail}` : ""}`;
  when.textContent = new Date().toLocaleTimeString("en-GB");
  line.append(mark, text, when);
  list.prepend(line);
  while (list.children.length > MOST) list.lastElementChild.remove();
}
