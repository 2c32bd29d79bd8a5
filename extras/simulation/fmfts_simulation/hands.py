"""A person's actions for a baseline, on a simulated pad: leave it alone, turn it, press it, put a weight on it."""

from __future__ import annotations

from dataclasses import dataclass

from fmfts_simulation.baseline import hold_still, pressed_pads
from fmfts_simulation.finger import REACH_M, Stroke, Touch, steady_finger
from fmfts_simulation.source import Simulated

ALONE_S = 0.5  # before the first press: measures the field at rest
PRESS_EVERY_S = 0.6
WEAKEST_N, STRONGEST_N = 0.3, 1.7
# Multiples of these, modulo one, fill a square and a line evenly however many are taken (M. Roberts, R2 sequence).
PLACE_STEPS, FORCE_STEP = (0.7548776662, 0.5698402910), 0.6180339887


@dataclass(frozen=True, slots=True)
class PressesAllOver:
    """A finger that presses another place with another force every PRESS_EVERY_S, from `begin_s` on."""

    begin_s: float

    def __call__(self, time_s: float) -> Touch:
        number, within_s = divmod(time_s - self.begin_s - ALONE_S, PRESS_EVERY_S)
        x_m, y_m = (REACH_M * (2.0 * ((0.5 + number * step) % 1.0) - 1.0) for step in PLACE_STEPS)
        if number < 0:
            return Touch(x_m, y_m, 0.0)
        force_n = WEAKEST_N + (STRONGEST_N - WEAKEST_N) * ((0.5 + number * FORCE_STEP) % 1.0)
        return Stroke(0.0, 0.75 * PRESS_EVERY_S, 0.12, force_n, (x_m, y_m), (x_m, y_m)).at(within_s)


class Hands:
    """Holds the pad as HandledSource says, until `let_go`."""

    def __init__(self, source: Simulated, *, bare: bool, turn: bool, refine: bool, weight_n: float = 0.0) -> None:
        self._source = source
        self._fingers = [(each.finger, each.second_finger) for each in pressed_pads(source)]
        self._before = source.mounted, source.tumbling, source.turning_rad_per_s
        hold_still(source, mounted=not bare)
        source.tumbling = turn
        if refine:
            source.finger = PressesAllOver(source.time_s)
        if weight_n:
            source.finger = steady_finger(0.0, 0.0, weight_n)

    def let_go(self) -> None:
        """Restores the pad and its configured motion."""
        source = self._source
        source.mounted, source.tumbling, source.turning_rad_per_s = self._before
        source.turning_since_s = source.time_s  # from its present orientation, without a jump
        for pad, fingers in zip(pressed_pads(source), self._fingers, strict=True):
            pad.finger, pad.second_finger = fingers
