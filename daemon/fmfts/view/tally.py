"""Counts the messages of one pad, and summarises them."""

from __future__ import annotations

from collections import defaultdict, deque

from fmfts_client import ALIVE_S, Contact, Finger, Status

WITHOUT_FRAMES = "stale", "disconnected"  # such a message repeats the last frame's time
WINDOW_NS = 1_000_000_000
LATENCIES_KEPT = 100_000  # seven minutes at 220 Hz


class Tally:
    """Feed it every contact in order; the attributes are the summary."""

    def __init__(self, pad: str) -> None:
        self.pad = pad
        self.status: Status | None = None
        self.contact: Contact | None = None
        self.messages = 0
        self.lost = 0
        self.restarts = 0
        self.touches = 0
        self.largest_force_n: float | None = None
        self.arrival_s: float | None = None  # age of the newest sample when its message arrived
        self.health_s: defaultdict[str, float] = defaultdict(float)
        self._published_ns: deque[int] = deque()
        self._latencies_s: deque[float] = deque(maxlen=LATENCIES_KEPT)
        self._first_ns = 0

    def add(self, contact: Contact) -> None:
        before, self.contact = self.contact, contact
        self.messages += 1
        self.arrival_s = None if contact.clock_ahead_s is None else contact.sample_age_s
        self._first_ns = self._first_ns or contact.t_publish_ns
        self._published_ns.append(contact.t_publish_ns)
        while contact.t_publish_ns - self._published_ns[0] > WINDOW_NS:
            self._published_ns.popleft()
        same_sample = before is not None and contact.t_sample_ns == before.t_sample_ns
        if contact.t_sample_ns and not same_sample and contact.health not in WITHOUT_FRAMES:
            self._latencies_s.append((contact.t_publish_ns - contact.t_sample_ns) * 1e-9)
        if before is not None:
            self._compare(before, contact)
        if contact.contact and not (before is not None and before.contact):
            self.touches += 1
        if contact.force_n is not None and contact.contact:
            self.largest_force_n = max(self.largest_force_n or 0.0, contact.force_n)

    def _compare(self, before: Contact, contact: Contact) -> None:
        if contact.boot != before.boot:
            self.restarts += 1
            return
        self.lost += max(0, contact.seq - before.seq - 1)
        passed_s = (contact.t_publish_ns - before.t_publish_ns) * 1e-9
        self.health_s[before.health if passed_s < ALIVE_S else "nothing arrived"] += passed_s

    @property
    def alive(self) -> bool:
        return self.contact is not None and self.contact.publish_age_s < ALIVE_S

    @property
    def rate_hz(self) -> float | None:
        """Rate of the messages of the last second; None if they only report that no frame comes."""
        without_frames = self.contact is None or self.contact.health in WITHOUT_FRAMES
        if without_frames or len(self._published_ns) < 2:
            return None
        return (len(self._published_ns) - 1) * 1e9 / (self._published_ns[-1] - self._published_ns[0])

    @property
    def mean_rate_hz(self) -> float | None:
        if self.contact is None or self.contact.t_publish_ns == self._first_ns:
            return None
        return (self.messages - 1) * 1e9 / (self.contact.t_publish_ns - self._first_ns)

    def latency_s(self, share: float) -> float | None:
        """Quantile `share` of the latency from sample to publishing."""
        ordered = sorted(self._latencies_s)
        return ordered[min(int(share * len(ordered)), len(ordered) - 1)] if ordered else None

    def facts(self) -> dict[str, object]:
        """The summary, for programs."""
        return {
            "pad": self.pad,
            "messages": self.messages,
            "rate_hz": self.mean_rate_hz,
            "lost": self.lost,
            "restarts": self.restarts,
            "latency_p50_s": self.latency_s(0.5),
            "latency_p99_s": self.latency_s(0.99),
            "latency_max_s": self.latency_s(1.0),
            "touches": self.touches,
            "largest_force_n": self.largest_force_n,
            "health_s": dict(self.health_s),
        }

    def sentence(self) -> str:
        """The summary, for people."""
        rate_hz, force_n = self.mean_rate_hz, self.largest_force_n
        latencies = [self.latency_s(share) for share in (0.5, 0.99, 1.0)]
        parts = [
            f"{self.messages} messages",
            "" if rate_hz is None else f"{rate_hz:.1f} Hz",
            f"{self.lost} lost",
            "latency p50/p99/max "
            + "/".join("–" if each is None else f"{each * 1e3:.2f}" for each in latencies)
            + " ms",
            f"{self.touches} touches" + ("" if force_n is None else f", hardest {force_n:.2f} N"),
            ", ".join(f"{health} {seconds:.1f} s" for health, seconds in sorted(self.health_s.items())),
            f"{self.restarts} restarts of the daemon" if self.restarts else "",
        ]
        last = self.contact
        why = "" if last is None or last.health == "ok" or not last.reason else f"\n{last.health}: {last.reason}"
        return f"pad {self.pad}: " + "; ".join(filter(None, parts)) + why


def now_line(tally: Tally) -> str:
    """The pad's present state, on one line."""
    contact = tally.contact
    if contact is None or not tally.alive:
        return f"{tally.pad}: nothing arrives"
    healthy = contact.health == "ok"
    parts = [f"{tally.pad}: {contact.health}" + (f" ({contact.reason})" if contact.reason and not healthy else "")]
    if contact.over_range:
        parts.append(f"more than {contact.force_min_n or 0.0:.2f} N")
    elif contact.contact is None:
        parts.append("contact not known")
    elif not contact.contact:
        parts.append("no contact")
    elif contact.contacts and len(contact.contacts) > 1:
        parts.append(" and ".join(_finger_text(finger) for finger in contact.contacts))
    elif contact.force_n is not None and contact.x_m is not None and contact.y_m is not None:
        deviation = "" if contact.force_sd_n is None else f" ± {contact.force_sd_n:.2f}"
        parts.append(f"{contact.force_n:.2f}{deviation} N at ({contact.x_m * 1e3:+.1f}, {contact.y_m * 1e3:+.1f}) mm")
    else:
        parts.append("contact")
    if contact.more:
        parts.append("two fingers do not explain this")
    if contact.displacement_m is not None:
        which = "magnet" if contact.more is None else "farthest magnet"
        parts.append(f"{which} {displacement_text(contact)} from rest")
    if tally.rate_hz is not None:
        parts.append(f"{tally.rate_hz:.1f} Hz")
    if contact.t_sample_ns:
        sample_to_publish_ms = (contact.t_publish_ns - contact.t_sample_ns) * 1e-6
        ago = "" if contact.clock_ahead_s is None else f", {contact.sample_age_s * 1e3:.1f} ms ago"
        parts.append(f"sampled {sample_to_publish_ms:.2f} ms before publishing{ago}")
    if contact.reason and healthy:
        parts.append(contact.reason)
    return "  ".join(parts)


def _finger_text(finger: Finger) -> str:
    place = f"({finger.x_m * 1e3:+.1f}, {finger.y_m * 1e3:+.1f}) mm"
    return f"finger {finger.id}: {finger.force_n:.2f} N at {place}"


def displacement_text(contact: Contact) -> str:
    """The magnet's distance from rest, as text in millimetres."""
    if contact.displacement_m is None:
        return "–"
    deviation = "" if contact.displacement_sd_m is None else f" ± {contact.displacement_sd_m * 1e3:.3f}"
    return f"{contact.displacement_m * 1e3:.3f}{deviation} mm"
