// Recordings: begin and end one, list those that there are, and show one in place of the daemon.

import { toast } from "./words.js";

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
      this.over = false;
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
