// Numbers of messages as a person reads them. What is not known is null, never zero.

export const known = (value) => (typeof value === "number" && Number.isFinite(value)) || typeof value === "bigint";
export const UNKNOWN = "not known";

// A number with a true minus sign, and no "−0.0".
export function shown(value, digits) {
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

// A deviation to its two leading digits, which are all that it is known to: 0.0048, 0.052, 21.
export function shownDeviation(value) {
  return shown(value, value > 0 ? Math.max(0, 1 - Math.floor(Math.log10(value))) : 0);
}

export function withDeviation(value, deviation, unit, digits, factor = 1) {
  if (!known(value)) return UNKNOWN;
  const spread = known(deviation) ? ` ± ${shown(deviation * factor, digits)}` : "";
  return `${shown(value * factor, digits)}${spread} ${unit}`;
}

// What a contact message says of the touch: "unknown", "none", "over" or "touch".
export function touchOf(contact) {
  if (!contact) return "unknown";
  if (contact.over_range) return "over";
  if (contact.contact === false) return "none";
  if (contact.contact === true) return "touch";
  return "unknown";
}

// The force in words; with its unit, and ± one standard deviation.
export function forceText(contact) {
  switch (touchOf(contact)) {
    case "over":
      return known(contact.force_min_n) ? `more than ${shown(contact.force_min_n, 2)} N` : "beyond the calibrated range";
    case "none":
      return "no contact";
    case "touch":
      if (known(contact.force_n)) return `${shown(contact.force_n, 2)} N${known(contact.force_sd_n) ? ` ± ${shown(contact.force_sd_n, 2)}` : ""}`;
      return known(contact.displacement_m) ? `touched; magnet moved ${withDeviation(contact.displacement_m, contact.displacement_sd_m, "mm", 3, 1e3)}` : "touched, force not known";
    default:
      return UNKNOWN;
  }
}

// Without a contact: how large a force may be there and not be noticed, which is two deviations.
export function atMost(contact, where) {
  return known(contact.force_sd_n) ? `less than ${shown(2 * contact.force_sd_n, 2)} N ${where}` : "";
}

// What touches: the fingers of a pad with several magnets where they are told, else the contact as one. The resultant of
// two fingers is a place where no finger is.
export function touchesOf(contact) {
  if (Array.isArray(contact?.contacts)) return contact.contacts;
  return contact?.contact && known(contact.x_m) && known(contact.y_m) ? [contact] : [];
}

// The magnets' poses: one, or those of a pad with several.
export function posesOf(contact) {
  return contact?.poses ?? (contact?.pose ? [contact.pose] : []);
}

const severalFingers = (contact) => touchesOf(contact).length > 1;

// "finger 3: 0.60 N ± 0.04 at x −4.0 mm, y 2.0 mm; finger 4: …", or "" where no two are told.
export function fingersText(contact) {
  if (!severalFingers(contact)) return "";
  const words = (finger) => `finger ${finger.id}: ${withDeviation(finger.force_n, finger.force_sd_n, "N", 2)} at x ${shown(finger.x_m * 1e3, 1)} mm, y ${shown(finger.y_m * 1e3, 1)} mm`;
  return contact.contacts.map(words).join("; ");
}

export function placeText(contact) {
  if (severalFingers(contact)) return "";
  if (!contact || contact.contact === false || !known(contact.x_m) || !known(contact.y_m)) return "";
  return `x ${shown(contact.x_m * 1e3, 1)} mm, y ${shown(contact.y_m * 1e3, 1)} mm`;
}

// One sentence that says what a drawing shows: "1.28 N ± 0.05 at x −5.8 mm, y −1.6 mm".
export function sentence(contact) {
  if (!contact) return "nothing arrives";
  const place = placeText(contact);
  const fingers = fingersText(contact);
  const touch = `${forceText(contact)}${place ? ` at ${place}` : fingers ? `: ${fingers}` : ""}${contact.more ? "; two fingers do not explain it" : ""}`;
  return contact.health === "ok" ? touch : `${contact.health.replace("_", " ")}: ${touch}`;
}

// A message as JSON: nanoseconds beyond 2^53 stay whole numbers.
export function asJson(message) {
  const mark = "\u0001";
  const text = JSON.stringify(message, (_, value) => (typeof value === "bigint" ? `${mark}${value}${mark}` : value), 1);
  return text.replaceAll(new RegExp(`"\\\\u0001(-?\\d+)\\\\u0001"`, "g"), "$1");
}
