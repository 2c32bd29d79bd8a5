"""Alignment as docs/tracking.md and the field's own shape say it: from the whole history of each sensor.

The instant is that of the sensor whose newest sample is oldest; each sensor is interpolated linearly between the two
samples around it (the newest two). The noise of a weighted mean w a + (1 − w) b of independent samples is
sqrt(w² + (1 − w)²). The bend is twice what a parabola through the last three samples differs from the chord at the
instant (twice: where a tap begins, half of its acceleration is in the divided difference); where the slope jumps by
more than half a gauss between two samples, the jump may be anywhere between them. Without a third sample it is the
step itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from oracle.field import Array

JUMP_T = 5e-5


@dataclass(slots=True)
class History:
    """All samples of one sensor: times in µs, fields (3,)."""

    times: list[int] = field(default_factory=list)
    fields: list[Array] = field(default_factory=list)

    def add(self, time_us: int, field_t: Array) -> None:
        self.times.append(time_us)
        self.fields.append(field_t)

    def repeats(self) -> list[int]:
        """How often in a row each axis has told the same."""
        found = []
        for axis in range(3):
            same = [one[axis] == other[axis] for one, other in zip(self.fields[1:], self.fields[:-1], strict=True)]
            found.append(next((number for number, equal in enumerate(reversed(same)) if not equal), len(same)))
        return found

    def at(self, instant_us: int) -> tuple[Array, float, Array]:
        """Field (3,), share of a sample's noise, and bend (3,)."""
        if len(self.times) == 1:
            return self.fields[-1], 1.0, np.zeros(3)
        t1, t0 = self.times[-2:]
        f1, f0 = self.fields[-2:]
        place = np.clip((instant_us - t1) / (t0 - t1), 0.0, 1.0)
        value = f1 + place * (f0 - f1)
        share = float(np.hypot(place, 1.0 - place))
        if len(self.times) == 2:
            return value, share, np.abs((1.0 - place) * (f0 - f1))
        t2, f2 = self.times[-3], self.fields[-3]
        bend = np.zeros(3)
        if 0.0 < place < 1.0:  # Lagrange's parabola
            at = float(instant_us)
            parabola = (
                f0 * ((at - t1) * (at - t2) / ((t0 - t1) * (t0 - t2)))
                + f1 * ((at - t0) * (at - t2) / ((t1 - t0) * (t1 - t2)))
                + f2 * ((at - t0) * (at - t1) / ((t2 - t0) * (t2 - t1)))
            )
            bend = 2.0 * np.abs(parabola - value)
        kink = np.abs((f0 - f1) / (t0 - t1) - (f1 - f2) / (t1 - t2)) * (t0 - t1)
        jumped = (kink > JUMP_T) & (place < 1.0)
        return value, share, np.where(jumped, max(place, 1.0 - place) * kink, bend)
