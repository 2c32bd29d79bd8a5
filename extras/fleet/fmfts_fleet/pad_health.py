"""The fleet page's facts about the pads of one robot, from the status that its daemon sends of each once a second."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fmfts_client import Status

# The health with which a controller can do least comes first; a word of a newer daemon comes before all others.
WORST_FIRST = ("disconnected", "lost", "stale", "no_baseline", "disturbed", "degraded", "ok")
LONGEST_TEXT, MOST_FAULTS = 500, 16  # longest text of a robot: the page keeps and sends no more


@dataclass(frozen=True)
class PadHealth:
    """One pad, as in its newest status. for_s: how long it had its health when the daemon sent this."""

    pad: str
    health: str
    reason: str
    sensor_faults: tuple[str, ...]
    rate_hz: float
    rate_nominal_hz: float
    for_s: float

    @classmethod
    def of(cls, status: Status) -> PadHealth:
        faults = tuple(fault[:LONGEST_TEXT] for fault in status.sensor_faults[:MOST_FAULTS])
        return cls(
            status.pad[:LONGEST_TEXT],
            status.health[:LONGEST_TEXT],
            status.reason[:LONGEST_TEXT],
            faults,
            status.rate_hz,
            status.rate_nominal_hz,
            round(max(status.t_publish_ns - status.since_ns, 0) * 1e-9, 1),
        )

    @property
    def is_sound(self) -> bool:
        """True if there is nothing to report. A pad may be "ok" with a reason, such as a computer that is
        overloaded."""
        return self.health == "ok" and not self.reason and not self.sensor_faults

    @property
    def rate_share(self) -> float:
        return self.rate_hz / self.rate_nominal_hz if self.rate_nominal_hz > 0.0 else 1.0

    @property
    def _rank(self) -> tuple[int, bool, float, str]:
        severity = WORST_FIRST.index(self.health) if self.health in WORST_FIRST else -1
        return severity, self.is_sound, self.rate_share, self.pad


def facts_of(pads: Sequence[PadHealth]) -> dict[str, Any]:
    """The number of pads, the rate of the slowest, how many have which health, and the worst; None: all are healthy."""
    slowest = min(pads, key=lambda pad: pad.rate_share, default=None)
    worst = min(pads, key=lambda pad: pad._rank, default=None)
    counted = Counter(pad.health for pad in sorted(pads, key=lambda pad: pad._rank))
    return {
        "pads": len(pads),
        "rate_hz": slowest and slowest.rate_hz,
        "rate_nominal_hz": slowest and slowest.rate_nominal_hz,
        "health": dict(counted),
        "worst": None
        if worst is None or worst.is_sound
        else {
            "pad": worst.pad,
            "health": worst.health,
            "reason": worst.reason,
            "sensor_faults": list(worst.sensor_faults),
            "for_s": worst.for_s,
        },
    }
