"""A pad that a script presses, so that its contacts can be judged at any moment."""

from __future__ import annotations

import random
import time
from abc import ABC, abstractmethod
from bisect import bisect
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts_client import Contact
from fmfts_lab.bench.recorded import pressed_field
from fmfts_lab.bench.truth import WRONG_DEVIATIONS, Truth
from fmfts_simulation.finger import Stroke, Touch, no_finger
from fmfts_simulation.mounted import MountedPad

STANDARD_PAD = PadConfig(name="standard", source=SimulatedSource()).pad()
REACH_M, FORCES_N = 6e-3, (0.4, 1.2)
PAUSE_S, HELD_S, RAMP_S = 0.5, 0.8, 0.2
STEP_S = 0.01  # between two moves; after a pause of the drill the finger goes on from where it was
# After this time a constant finger is measured: the slowest chip's conversion is over, and its smoothing.
SETTLED_NS, SURE_N = 100_000_000, 0.3


class Wrong(NamedTuple):
    """kind: "form", "numbers", "touched" or "not touched"."""

    contact: Contact
    kind: str
    what: str

    def __str__(self) -> str:
        return f"{self.what}: {self.contact}"


class PressedPad(ABC):
    """Nothing touches it before `press`; then `tend` moves the finger, and must be called often."""

    def __init__(self, seed: int = 5) -> None:
        self._built = MountedPad.exact(STANDARD_PAD)
        self._truth = Truth(self._built, lambda time_s: self._touch_at(round(time_s * 1e9)))
        self._chance = random.Random(seed)
        self._touch = no_finger(0.0)
        self._stroke: Stroke | None = None
        self._script_s = 0.0
        self._moved_s = time.monotonic()
        # Each move of the finger: earliest and latest time at which it was made, and where to.
        self._begun_ns, self._done_ns, self._touches = [0], [0], [self._touch]
        self.judged = self.judged_pressed = 0
        self._pressed = False

    @abstractmethod
    def is_plugged(self) -> bool: ...

    @abstractmethod
    def field(self, field_t: np.ndarray) -> None:
        """Set the field at its sensors (4, 3), in their own axes, in tesla."""

    def press(self) -> None:
        self._pressed = True

    def tend(self) -> None:
        now_s = time.monotonic()
        if not self._pressed or not self.is_plugged() or now_s - self._moved_s < STEP_S:
            return
        self._script_s += min(now_s - self._moved_s, 2 * STEP_S)
        self._moved_s = now_s
        if self._stroke is None or self._script_s > self._stroke.begin_s + HELD_S:
            self._stroke = self._next_stroke()
        touch = self._stroke.at(self._script_s)
        if touch != self._touch:
            self._move(touch)

    def _next_stroke(self) -> Stroke:
        place = [self._chance.uniform(-REACH_M, REACH_M) for _ in range(2)]
        force_n = self._chance.uniform(*FORCES_N)
        return Stroke(self._script_s + PAUSE_S, HELD_S, RAMP_S, force_n, (place[0], place[1]), (place[0], place[1]))

    def _move(self, touch: Touch) -> None:
        begun_ns = time.monotonic_ns()
        self.field(pressed_field(self._built, touch.x_m, touch.y_m, touch.force_n))
        self._begun_ns.append(begun_ns)
        self._done_ns.append(time.monotonic_ns())
        self._touches.append(touch)
        self._touch = touch

    def _touch_at(self, time_ns: int) -> Touch:
        return self._touches[bisect(self._begun_ns, time_ns) - 1]

    def _is_settled(self, time_ns: int) -> bool:
        return self._done_ns[bisect(self._begun_ns, time_ns) - 1] + SETTLED_NS < time_ns

    def moves_around(self, time_ns: int) -> list[str]:
        """The last two moves before, and the next two."""
        at = bisect(self._begun_ns, time_ns)
        moves = zip(self._begun_ns, self._done_ns, self._touches, strict=True)
        return [
            f"{(begun_ns - time_ns) * 1e-6:+.1f} to {(done_ns - time_ns) * 1e-6:+.1f} ms: {touch.force_n:.3f} N"
            for begun_ns, done_ns, touch in islice(moves, max(at - 2, 0), at + 2)
        ]

    def wrong(self, contact: Contact) -> str:
        """What is wrong with a contact of this pad, or ""; while the finger moves, only its form is judged."""
        return "".join(str(wrong) for wrong in self.all_wrong([contact]))

    def all_wrong(self, contacts: Sequence[Contact]) -> list[Wrong]:
        """The same for many, in a tenth of the time for each."""
        wrong: list[Wrong] = []
        settled = []
        for contact in contacts:
            numbers = (contact.force_n, contact.x_m, contact.y_m, contact.force_min_n)
            if contact.health not in ("ok", "degraded"):
                if any(number is not None for number in numbers):
                    wrong.append(Wrong(contact, "form", f"{contact.health} with a number"))
            elif contact.health == "ok" and contact.pose is None:
                wrong.append(Wrong(contact, "form", "ok without a pose"))
            elif self._is_settled(contact.t_sample_ns):
                settled.append(contact)
        deviations = self._truth.all_deviations(settled)  # type: ignore[arg-type]  # a message has the same attributes
        for contact, away in zip(settled, deviations, strict=True):
            touch = self._touch_at(contact.t_sample_ns)
            self.judged += 1
            self.judged_pressed += touch.force_n > SURE_N
            if not away <= WRONG_DEVIATIONS:
                wrong.append(Wrong(contact, "numbers", f"{away:.1f} deviations off {touch}"))
            elif contact.contact and not touch.force_n:
                wrong.append(Wrong(contact, "touched", "touched, and nothing touches it"))
            elif contact.contact is False and touch.force_n > SURE_N:
                wrong.append(Wrong(contact, "not touched", f"not touched, and {touch} touches it"))
        return wrong
