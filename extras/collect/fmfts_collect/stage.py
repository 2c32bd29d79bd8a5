"""Presses the pad with a G-code machine: goes to places without backlash, and approaches forces in small steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress

from fmfts_collect.errors import AbsentError, RefusedError, StoppedError
from fmfts_collect.guard import Guard
from fmfts_collect.machine import SHORT_S, Machine
from fmfts_collect.plan import Press
from fmfts_collect.settings import StageConfig
from fmfts_collect.watch import Watch

TOUCH_N = 0.03  # a gauge of ±5 mN never reads more by chance
NEAR_MM = 0.3  # the steps begin this far above the surface that the last press found
TILT = 0.05  # they begin higher by this for each mm from the last press, because pads are tilted
READINGS = 3  # the force after a step is the mean of this many readings
PATIENCE_S = 1.0
ATTEMPTS = 3  # at one row
MOST_STEPS = 400  # from the first touch on
SMALLEST_FORCE_ERROR_N = 0.01  # a gauge of ±5 mN cannot show less
LONGER = 4.0  # longest step, in step_mm, where the stiffness is known
CAUTION = 0.8  # share of the step that a linear spring would need: silicone stiffens


class Stage:
    """A Presser. tolerance: of a reached force, relative."""

    def __init__(self, config: StageConfig, watch: Watch, tolerance: float) -> None:
        self._config = config
        self._watch = watch
        self._tolerance = tolerance
        self._machine = Machine(config, watch.clock)
        self._guard: Guard | None = None
        self._down = False
        self._surface: tuple[float, float, float] | None = None  # where the last press began to touch
        self._n_per_mm = 0.0
        self._last: tuple[float, float] | None = None  # z, force of the last step

    @property
    def description(self) -> str:
        return f"the {self._config.dialect} stage on {self._config.port}"

    def begin(self) -> None:
        """Home, go up to where nothing is touched, and start the guard."""
        if self._watch.readings:
            self._watch.tare_n += self._settled_force_n()  # the weight of the rod
        self._machine.listen = lambda: self._watch.turn(moving=True)
        self._machine.begin()
        self.lift()
        rescue = self._machine.rescue(self._config.clear_z_mm, self._config.lift_mm_per_s)
        self._guard = Guard(self._machine.fileno(), rescue)
        self._watch.heartbeat = self._machine.heartbeat = self._beat

    def refused(self, why: str, times: int, once_more: Callable[[], None]) -> None:
        """Let the session record the row again, ATTEMPTS times; the machine holds its force anyway."""
        if times == ATTEMPTS:
            raise RefusedError(f"refused {ATTEMPTS} times: {why}")

    def lift(self) -> None:
        self._machine.move(z=self._config.clear_z_mm, mm_per_s=self._config.lift_mm_per_s)
        self._watch.on_guard = False
        self._last = None
        self._down = False
        self._beat()

    def stand_over(self, press: Press) -> None:
        """Go over the place of a press with the rod up; approach it from below in x and y, against backlash."""
        x, y = machine_place(self._config, press)
        speed, before = self._config.travel_mm_per_s, self._config.overshoot_mm
        if before:
            self._machine.move(x=x - before, y=y - before, mm_per_s=speed)
        self._machine.move(x=x, y=y, mm_per_s=speed)

    def press(self, press: Press) -> None:
        """Go down until the force is reached. Raises StoppedError where it cannot be reached."""
        self._watch.on_guard = self._down = True
        if self._last is None and self._surface is not None:
            self._machine.move(z=self._near_mm(self._surface), mm_per_s=self._config.lift_mm_per_s)
        steps = 0
        while steps < MOST_STEPS:
            force_n = self._settled_force_n()
            error_n = press.force_n - force_n
            if abs(error_n) <= max(self._tolerance * press.force_n, SMALLEST_FORCE_ERROR_N):
                return
            self._learn(force_n)
            steps += force_n >= TOUCH_N
            self._creep(self._step_mm(force_n, error_n), force_n)
        raise StoppedError(f"{press.force_n:.3f} N was not reached in {MOST_STEPS} steps: the force swings about it")

    def release(self) -> str:
        """Lift the rod, by an emergency stop if nothing else works; returns a sentence about the outcome."""
        self._machine.heartbeat = self._watch.heartbeat = self._beat_anyway
        why_lifted = "" if self._guard is None else self._guard.why_lifted()
        outcome = f"its guard sent the rod up, because {why_lifted}" if why_lifted else self._lift_anyway()
        self._down = False
        self._beat_anyway()
        return outcome

    def _lift_anyway(self) -> str:
        place = self._machine.place
        self._watch.on_guard = False
        if self._machine.homed is None:
            return "the stage was not homed yet"
        if place is None or not self._machine.homed:
            self._machine.emergency_stop()
            return "the stage was not homed yet, and got the emergency stop: see that the rod is up before you go on"
        rise_mm = self._config.clear_z_mm - self._machine.lowest_mm()
        if rise_mm <= 0.0:
            return self._halted_up()
        if self._machine.rise(self._config.clear_z_mm, self._config.lift_mm_per_s):
            return f"the rod was lifted by {rise_mm:.2f} mm"
        self._machine.emergency_stop()
        return "THE ROD MAY STILL PRESS: the stage did not rise, and got the emergency stop; lift it by hand"

    def close(self) -> None:
        if self._guard is not None:
            self._guard.close(lift=self._down)
            self._guard = None
        self._machine.close()

    def _beat(self) -> None:
        if self._guard is not None:
            self._guard.beat(down=self._down)

    def _beat_anyway(self) -> None:
        """While the rod rises after an error: a guard that does not listen any more changes nothing then."""
        with suppress(StoppedError):
            self._beat()

    def _halted_up(self) -> str:
        try:
            self._machine.halt()
        except AbsentError:
            return "the rod was up, and the stage has gone: it ends its move"
        return "the rod was up"

    def _near_mm(self, surface: tuple[float, float, float]) -> float:
        assert self._machine.place is not None
        away_mm = math.dist(surface[:2], self._machine.place[:2])
        return min(surface[2] + NEAR_MM + TILT * away_mm, self._config.clear_z_mm)

    def _creep(self, deeper_mm: float, force_n: float) -> None:
        """Goes down in moves so short that a rise need not halt them, after which Marlin is deaf for a second."""
        assert self._machine.place is not None
        from_mm, low_mm = self._machine.place[2], self._config.travel_mm[2][0]
        if force_n < TOUCH_N and from_mm - deeper_mm < low_mm:
            raise StoppedError(
                f"nothing was touched down to z = {from_mm:.2f} mm, and collect.stage.travel_mm ends at {low_mm:g} mm: "
                f"is the pad under the rod? The gauge reads {force_n:.3f} N: does it change when you push the rod?"
            )
        moves = math.ceil(abs(deeper_mm) / (SHORT_S * self._config.press_mm_per_s) - 1e-9)
        for number in range(1, moves + 1):
            self._machine.move(z=from_mm - deeper_mm * number / moves, mm_per_s=self._config.press_mm_per_s)

    def _settled_force_n(self) -> float:
        """Mean of READINGS readings from after the last move, without the first: it may still show the move's end."""
        since_ns = self._watch.clock.now_ns()
        watch = self._watch

        if not watch.until(lambda: len(watch.forces_since(since_ns)) > READINGS, PATIENCE_S):
            raise StoppedError(f"the gauge gave fewer than {READINGS + 1} readings in {PATIENCE_S:g} s")
        return sum(watch.forces_since(since_ns)[-READINGS:]) / READINGS - watch.tare_n

    def _learn(self, force_n: float) -> None:
        """Estimates the stiffness and the height of the surface from this step and the last."""
        assert self._machine.place is not None
        z_mm = self._machine.place[2]
        if self._last is not None:
            depth_change_mm, force_change_n = self._last[0] - z_mm, force_n - self._last[1]
            rises = force_change_n * depth_change_mm > 0.0
            if abs(force_change_n) > SMALLEST_FORCE_ERROR_N and rises and force_n > TOUCH_N:
                self._n_per_mm = force_change_n / depth_change_mm
        if force_n < TOUCH_N:
            self._surface = self._machine.place  # the surface is at this depth or deeper
        self._last = (z_mm, force_n)

    def _step_mm(self, force_n: float, error_n: float) -> float:
        """The next step down in mm; negative if the force is too large."""
        step_mm = self._config.step_mm
        if force_n < TOUCH_N or not self._n_per_mm:
            return math.copysign(step_mm, error_n)
        wanted_mm = CAUTION * error_n / self._n_per_mm
        return max(-LONGER * step_mm, min(LONGER * step_mm, wanted_mm))


def machine_place(config: StageConfig, press: Press) -> tuple[float, float]:
    """Machine coordinates x, y (mm) of a press."""
    turn = math.radians(config.turn_deg)
    x_mm, y_mm = press.x_m * 1e3, press.y_m * 1e3
    return (
        config.origin_mm[0] + x_mm * math.cos(turn) - y_mm * math.sin(turn),
        config.origin_mm[1] + x_mm * math.sin(turn) + y_mm * math.cos(turn),
    )


def require_within_reach(config: StageConfig, presses: Sequence[Press]) -> None:
    """Raise RefusedError for a press beyond the travel or the force limit, before anything moves."""
    for press in presses:
        for axis, value, (low, high) in zip("xy", machine_place(config, press), config.travel_mm[:2], strict=True):
            if not low <= value - config.overshoot_mm <= value <= high:
                raise RefusedError(
                    f"press {press.number} at ({press.x_m * 1e3:g}, {press.y_m * 1e3:g}) mm needs the stage at "
                    f"{axis} = {value:.2f} mm, beyond collect.stage.travel_mm ({low:g} to {high:g}): check origin_mm "
                    "and the plan"
                )
        if press.force_n >= config.force_limit_n:
            raise RefusedError(
                f"press {press.number} wants {press.force_n:g} N, and collect.stage.force_limit_n is "
                f"{config.force_limit_n:g} N"
            )
