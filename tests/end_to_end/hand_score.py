"""Judges three methods on a hand whose true forces are known: a fixed baseline, and a daemon without and with a turn.

Only steady moments are judged. A force that misses the true one by more than CERTAIN_SD of its own deviations is wrong.
A message with another health than `ok`, or without a force, counts as not known.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# A force that changes by 3 N/s is off by 0.03 N after the 10 ms from sample to message.
SETTLED_S, STEADY_N, FEWEST_MOVES = 0.15, 0.02, 4
CERTAIN_SD = 5.0
# A fixed baseline reports no contact: its users compare its force with a limit.
USUAL_LIMIT_N = 0.2
GHOST, UNTURNED, TURNED = "ghost", "unturned", "turned"
TITLES = {GHOST: "a fixed baseline", UNTURNED: "fmfts-daemon, never turned", TURNED: "fmfts-daemon, turned"}


@dataclass
class Verdict:
    """Counts of messages about steady moments. false_contacts: without a touch, whatever the health."""

    ok: int = 0
    unknown: int = 0
    wrong: int = 0
    worst_n: float = 0.0
    untouched: int = 0
    false_contacts: int = 0

    def add(self, other: Verdict) -> None:
        self.ok += other.ok
        self.unknown += other.unknown
        self.wrong += other.wrong
        self.worst_n = max(self.worst_n, other.worst_n)
        self.untouched += other.untouched
        self.false_contacts += other.false_contacts


NOT_KNOWN = "not known"


@dataclass(frozen=True)
class Said:
    """The content of a message. force_n: None if it has none, or if its health is not `ok`."""

    force_n: float | None
    force_sd_n: float
    is_contact: bool

    @classmethod
    def of(cls, body: Mapping[str, Any]) -> Said:
        """body: a contact message, or one of `fmfts_page.ghost`."""
        force_n = body["force_n"]
        contact = body.get("contact", force_n is not None and force_n > USUAL_LIMIT_N)
        is_known = body.get("health", "ok") == "ok" and force_n is not None and not body.get("over_range")
        return cls(force_n, body["force_sd_n"], contact is True) if is_known else cls(None, 0.0, contact is True)

    def __str__(self) -> str:
        if self.force_n is None:
            return NOT_KNOWN
        return f"{self.force_n:.2f} ± {self.force_sd_n:.2f} N" + (", contact" if self.is_contact else "")


class Score:
    """The verdict on each method, with its worst moments. names: of the pads, in the order of their forces."""

    def __init__(self, names: Sequence[str], moves_a_second: int) -> None:
        self._names = names
        self._forces: deque[tuple[float, list[float]]] = deque(maxlen=moves_a_second * 5)
        self.ways = {way: Verdict() for way in TITLES}
        self._newest: dict[str, dict[str, Said]] = {way: {} for way in TITLES}  # by pad
        self.doubtful: list[str] = []  # false contacts and wrong forces of the turned daemon, to find their reasons

    def moved(self, time_s: float, forces_n: list[float]) -> None:
        """The boards have these forces from now on (time.monotonic())."""
        self._forces.append((time_s, forces_n))

    def take(self, way: str, pad: str, body: Mapping[str, Any]) -> None:
        """A message of `way` about `pad`: a contact message, or one of `fmfts_page.ghost`."""
        said = self._newest[way][pad] = Said.of(body)
        true_n = self._steady_n(pad, body["t_sample_ns"] * 1e-9)
        if true_n is None:
            return
        verdict, is_false = self.ways[way], said.is_contact and true_n == 0.0
        verdict.untouched += true_n == 0.0
        verdict.false_contacts += is_false
        if said.force_n is None:
            verdict.unknown += 1
        else:
            off_n = abs(said.force_n - true_n)
            is_wrong = off_n > CERTAIN_SD * said.force_sd_n
            verdict.ok += 1
            verdict.worst_n = max(verdict.worst_n, off_n)
            verdict.wrong += is_wrong
            is_false |= is_wrong
        if is_false and way == TURNED:
            self.doubtful.append(f"{pad} at {body['t_sample_ns'] * 1e-9:.3f} s: true {true_n:.2f} N, {dict(body)}")

    def beside(self) -> str:
        """What the three methods report about the pad on which they differ most; "" if they agree."""
        apart_n = {pad: self._apart_n(pad) for pad in self._names}
        pad = max(apart_n, key=apart_n.__getitem__)
        if apart_n[pad] < USUAL_LIMIT_N or not self._forces:
            return ""
        true_n = self._forces[-1][1][self._names.index(pad)]
        said = (f"{TITLES[way]}: {self._newest[way].get(pad, NOT_KNOWN)}" for way in (TURNED, UNTURNED, GHOST))
        return f"{pad}, true {true_n:.2f} N. " + "; ".join(said)

    def _apart_n(self, pad: str) -> float:
        forces_n = [said[pad].force_n or 0.0 for said in self._newest.values() if pad in said]
        return max(forces_n, default=0.0) - min(forces_n, default=0.0)

    def _steady_n(self, pad: str, sampled_s: float) -> float | None:
        """The true force (N) on the pad; None while it changes, or if it is not known."""
        number = self._names.index(pad)
        around = [forces[number] for moment, forces in self._forces if abs(moment - sampled_s) < SETTLED_S]
        if len(around) < FEWEST_MOVES or max(around) - min(around) > STEADY_N:
            return None
        return around[-1] if min(around) > 0.0 else max(around)


def is_better(ways: Mapping[str, Verdict]) -> bool:
    """True if the turned daemon is better than the fixed baseline, without a false contact and without a wrong
    force."""
    turned, ghost = ways[TURNED], ways[GHOST]
    return not turned.false_contacts and not turned.wrong and turned.ok > 0 and turned.worst_n < ghost.worst_n


def table(ways: Mapping[str, Verdict]) -> list[str]:
    """Each method's result in a line; the last line says whether the turned daemon is better than the fixed
    baseline."""
    lines = [
        f"{'':28}    ok   not known   wrong (> {CERTAIN_SD:g} deviations)   worst if ok   contacts without a touch"
    ]
    for way, verdict in ways.items():
        wrong = f"{verdict.wrong} ({100.0 * verdict.wrong / max(verdict.ok, 1):.1f} %)"
        false = f"{verdict.false_contacts} of {verdict.untouched}"
        lines.append(
            f"{TITLES[way]:28}{verdict.ok:6}{verdict.unknown:12}{wrong:>26}{verdict.worst_n:12.2f} N{false:>27}"
        )
    turned, ghost = ways[TURNED], ways[GHOST]
    lines.append(
        f"{'better' if is_better(ways) else 'NOT BETTER'} than a fixed baseline: {TITLES[TURNED]} has "
        f"{turned.false_contacts} contacts without a touch ({ghost.false_contacts}), {turned.wrong} wrong forces "
        f"({ghost.wrong}), and is {turned.worst_n:.2f} N off at the worst ({ghost.worst_n:.2f} N)"
    )
    return lines
