// What is wrong, in words, and what to do: from health, reason and sensor_faults, as docs/troubleshooting.md has it.

let advice = { health: {}, reasons: {} };

export async function loadAdvice() {
  advice = await (await fetch("advice.json")).json();
}

// {health, reason, advice} of what is shown now; health "wait" before anything arrived. replay: {shown, over}.
export function wordsOf(contact, status, linkState, replay) {
  if (!contact) {
    if (linkState !== "open") return { health: "gone", word: "no connection", reason: "", advice: "" };
    if (replay.over) return { health: "wait", word: "the end", reason: "of the recording", advice: "press `O` to show it again, another one, or the daemon" };
    if (replay.shown) return { health: "wait", word: "nothing", reason: "in the recording at this moment", advice: "" };
    return status?.everArrived
      ? { health: "gone", word: "nothing arrives", reason: "The daemon sends nothing.", advice: advice.health.silent ?? "" }
      : { health: "wait", word: "waiting", reason: "for fmfts-daemon", advice: advice.health.silent ?? "" };
  }
  const faults = (status?.sensor_faults ?? []).filter((fault) => !contact.reason.includes(fault));
  const known = Object.entries(advice.reasons).find(([words]) => contact.reason.includes(words));
  const more = contact.more ? "two fingers do not explain the field: there are more, or something else presses" : "";
  const over = contact.over_range ? "pressed harder than this pad is calibrated for: only a lower bound of the force is known" : "";
  const reason = [over, contact.reason, more, ...faults].filter(Boolean).join("; ");
  const help = known ? known[1] : contact.health === "ok" && !faults.length ? "" : advice.health[contact.health === "ok" ? "degraded" : contact.health] ?? "";
  if (over && contact.health === "ok") return { health: "over", word: "over range", reason, advice: help || "press less; for more force calibrate the pad for it" };
  return { health: contact.health, word: contact.health.replace("_", " "), reason, advice: help };
}

// Text with `code` in backticks, as elements.
export function withCode(element, text) {
  element.replaceChildren(
    ...text.split("`").map((part, number) => (number % 2 ? Object.assign(document.createElement("code"), { textContent: part }) : part)),
  );
}

export function toast(text) {
  const box = document.getElementById("toast");
  box.textContent = text;
  box.classList.add("shown");
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => box.classList.remove("shown"), 4000);
}
