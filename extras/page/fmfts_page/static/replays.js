// Recordings: begin and end one, list those that there are, and show one in place of the daemon.

import { toast } from "./words.js";

const SPEEDS = { 0.25: "at a quarter of its speed", 1: "at its own speed", 4: "at four times its speed" };

// The file that the daemon plays in place of a board, from a pad's status (extras/recording); null where there is a board.
export const playedByDaemon = (status) => (status?.source.startsWith("recording ") ? status.source.split("/").at(-1) : null);

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
    this.bar = document.getElementById("replay");
    this.place = document.getElementById("replay-place");
    this.bar.querySelector("button").addEventListener("click", () => this.back());
    this.place.addEventListener("input", () => (this.held = true)); // it is being moved
    this.place.addEventListener("change", () => this.show(this.shown, this.speed, Number(this.place.value)));
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
      list.append(...done.recordings.map((name) => this.row(name, "Show", () => this.show(name, Number(this.dialog.querySelector("#speed").value)))));
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

  // fromS: the place in the recording, in s after its beginning.
  async show(name, speed, fromS = 0) {
    try {
      const { done } = await this.link.request("replay", { name, speed, from_s: fromS });
      Object.assign(this, { shown: name, speed, fromS, lastsS: done.lasts_s, over: false, begunMs: null, held: false });
      this.switched(done.pads);
      this.say(null);
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
      this.say(null);
    } catch (error) {
      toast(error.message);
    }
  }

  // The line above a replay: of which recording, how fast, and the place in it. ms: what is shown, on the recording's
  // clock; null before its first message.
  say(ms) {
    this.bar.hidden = this.shown === null;
    if (this.bar.hidden) return;
    this.begunMs ??= ms;
    const atS = this.fromS + (ms === null ? 0 : (ms - this.begunMs) / 1e3);
    this.bar.querySelector("b").textContent = `Replay of ${this.shown}`;
    this.bar.querySelector("span").textContent = `${this.over ? "is over" : SPEEDS[this.speed]}, ${atS.toFixed(0)} s of ${this.lastsS.toFixed(0)} s`;
    if (this.held) return;
    this.place.max = this.lastsS;
    this.place.value = atS;
  }
}
