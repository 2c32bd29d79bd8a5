// Recordings: begin and end one, list those that there are, and show one in place of the daemon.

import { toast } from "./words.js";

const SPEEDS = { 0.25: "a quarter of its", 1: "its own", 4: "four times its" };

export class Replays {
  // switched(facts): facts of the pads in a recording, or null when the daemon is shown again.
  constructor(link, dialog, button, switched) {
    this.link = link;
    this.dialog = dialog;
    this.button = button;
    this.switched = switched;
    this.shown = null;
    this.over = false; // the recording that is shown was shown to its end
    this.failure = null;
    link.addEventListener("said", ({ detail }) => {
      if ("recording" in detail) this.mark(detail.recording);
      if ("recording_failed" in detail && detail.recording_failed !== this.failure) {
        this.failure = detail.recording_failed;
        if (this.failure) toast(this.failure);
      }
    });
    link.addEventListener("state", ({ detail }) => {
      if (detail.state === "open" && this.shown) this.back();
    });
  }

  mark(name) {
    this.under_way = name;
    this.button.setAttribute("aria-pressed", String(name !== null));
    this.button.firstElementChild.textContent = name === null ? "Record" : "Stop";
    this.button.title = name ?? "";
  }

  async toggle() {
    const on = !this.under_way;
    if (on && this.shown) return toast("this is a replay: go back to the daemon to record it");
    try {
      if (on) toast("the recorder begins …");
      const { done } = await this.link.request("record", { on });
      this.mark(on ? done.recording : null);
      toast(on ? `recording all pads into ${done.recording}` : `${done.messages} messages in ${done.recording}`);
    } catch (error) {
      toast(error.message);
    }
  }

  async open() {
    const list = this.dialog.querySelector("#recording-list"), folder = this.dialog.querySelector("#recordings-folder");
    list.replaceChildren();
    this.dialog.showModal();
    try {
      const { done } = await this.link.request("recordings");
      folder.textContent = done.recordings.length ? `In ${done.folder}, the newest first.` : `There is none in ${done.folder} yet: press Record.`;
      if (this.shown) list.append(this.row("the daemon, live", "Back", () => this.back()));
      list.append(...done.recordings.map((name) => this.row(name, "Show", () => this.show(name))));
    } catch (error) {
      folder.textContent = error.message;
    }
  }

  row(name, word, action) {
    const row = document.createElement("li"), button = Object.assign(document.createElement("button"), { textContent: word });
    button.setAttribute("aria-label", `${word} ${name}`);
    button.addEventListener("click", () => {
      this.dialog.close();
      action();
    });
    row.append(name, button);
    return row;
  }

  async show(name) {
    try {
      const speed = Number(this.dialog.querySelector("#speed").value);
      const { done } = await this.link.request("replay", { name, speed });
      this.shown = name;
      this.speed = speed;
      this.over = false;
      this.begunMs = null;
      this.switched(done.pads);
    } catch (error) {
      toast(error.message);
    }
  }

  // why: what is wrong with the file; "" at its end.
  ended(why) {
    this.over = true;
    toast(why || `the end of ${this.shown}`);
  }

  async back() {
    try {
      await this.link.request("replay", { name: null });
      this.shown = null;
      this.over = false;
      this.switched(null);
    } catch (error) {
      toast(error.message);
    }
  }
}

// The line above a replay: of which recording, how fast, and how far into it. clockMs: {ms} on the recording's clock.
export function sayReplay(line, replays, clockMs) {
  line.hidden = replays.shown === null;
  if (line.hidden) return;
  replays.begunMs ??= clockMs?.ms ?? null;
  const into = clockMs && replays.begunMs !== null ? `, ${((clockMs.ms - replays.begunMs) / 1e3).toFixed(0)} s after its beginning` : "";
  line.children[0].textContent = `Replay of ${replays.shown}`;
  line.children[1].textContent = replays.over ? "is over" : `at ${SPEEDS[replays.speed] ?? replays.speed} speed${into}`;
  line.children[2].onclick = () => replays.back();
}
