// Buttons and keys, and which action each has.

const BUTTONS = { pause: "pause", record: "record", replays: "replays", "first-use": "guide", theme: "theme", help: "help" };
const LETTERS = { " ": "pause", r: "record", o: "replays", g: "guide", t: "theme", "?": "help", c: "copy" };

export class Keys {
  constructor(actions) {
    for (const [id, action] of Object.entries(BUTTONS)) document.getElementById(id).addEventListener("click", () => actions[action]());
    document.getElementById("short").addEventListener("click", () => actions.seconds(10));
    document.getElementById("long").addEventListener("click", () => actions.seconds(600));
    document.addEventListener("keydown", (event) => this.press(event, actions));
  }

  press(event, actions) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const inside = event.target.closest("input:not([type=range]), select, textarea, dialog");
    if (event.key === "Escape" && inside?.id === "guide") inside.close();
    const isSlider = event.target.type === "range";
    if (inside || (isSlider && event.key.startsWith("Arrow")) || (event.key === " " && event.target.closest("button, summary"))) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (key in LETTERS) actions[LETTERS[key]]();
    else if (key === "m") actions.seconds();
    else if (/^[1-9]$/.test(key)) actions.pad(Number(key) - 1);
    else if (key === "ArrowLeft" || key === "ArrowRight") {
      const way = key === "ArrowLeft" ? -1 : 1;
      actions.step(way, event.shiftKey ? way * 0.1 : 0);
    } else return;
    event.preventDefault();
  }
}
