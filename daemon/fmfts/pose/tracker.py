"""Follows one magnet from frame to frame, and says when it cannot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.chi2 import quantile
from fmfts.pad import Pad
from fmfts.pose.solver import FREE_PAPER, PoseEstimate, Status, solve
from fmfts.pose.state import State

Array = NDArray[np.float64]

# Healthy frames that the χ² gate rejects: one in an hour at 220 Hz is 1.3e-6.
FALSE_ALARM = 1e-6
# A thousandth of a deviation: before rest is recorded, deviations hold the mounting's tolerances and are 0.4 mm wide.
STOP_TRACKING = 1e-6
# While a disturbance lasts, the search for a single sensor at fault is repeated once in so many frames: it costs five
# solves that take their time, because none of them fits.
SEARCH_EVERY = 8
# Fewer whole sensors than this leave poses that fit as well as the true one.
FEWEST_SENSORS = 3
# A magnet further from rest than this, or with a moment this many times off, is not the pad's any more.
REACH_M = 8e-3
MOMENT_FACTOR = 3.0


TrackHealth = Literal["ok", "degraded", "disturbed", "lost"]


@dataclass(frozen=True, slots=True)
class Track:
    """estimate: None where nothing could be solved. used: (N, 3) axes behind it. reason: empty when ok."""

    estimate: PoseEstimate | None
    used: NDArray[np.bool_]
    health: TrackHealth
    reason: str


class Tracker:
    """Levenberg–Marquardt started from the last good frame, gated by χ²; one bad sensor is found and left out."""

    def __init__(self, pad: Pad, rest: State) -> None:
        self._pad = pad
        self._rest = rest
        self._last = rest
        self._disturbed_frames = 0
        self._verdict: tuple[TrackHealth, str] = ("lost", "")

    def update(self, field_t: Array, deviation_t: Array) -> Track:
        """field_t (N, 3): the magnet's field in sensor axes, NaN where there is none; deviation_t (N, 3)."""
        used = np.isfinite(field_t)
        whole: NDArray[np.bool_] = np.asarray(used.all(axis=1), dtype=np.bool_)
        if whole.sum() < FEWEST_SENSORS:
            self._last = self._rest
            return Track(None, used, "lost", f"{_listed(~whole)} silent or saturated: fewer than three are left")
        estimate = self._solve(field_t, deviation_t)
        if self._fits(estimate):
            self._disturbed_frames = 0
            self._last = estimate.state
            if whole.all():
                return Track(estimate, used, "ok", "")
            return Track(estimate, used, "degraded", f"{_listed(~whole)} silent or saturated: left out")
        return self._without_one(field_t, deviation_t, estimate)

    def _solve(self, field_t: Array, deviation_t: Array) -> PoseEstimate:
        """From the last pose; if that does not fit, from rest as well."""
        estimate = solve(
            field_t, self._pad, self._last, deviation_t=deviation_t, free=FREE_PAPER, stop_chi2=STOP_TRACKING
        )
        if self._fits(estimate) or self._last is self._rest:
            return estimate
        again = solve(field_t, self._pad, self._rest, deviation_t=deviation_t, free=FREE_PAPER, stop_chi2=STOP_TRACKING)
        better = again.status is Status.CONVERGED and not again.chi2 >= estimate.chi2
        return again if better else estimate

    def _without_one(self, field_t: Array, deviation_t: Array, whole: PoseEstimate) -> Track:
        """The frame without the one sensor that explains its misfit; `disturbed` where none or several would."""
        used = np.isfinite(field_t)
        if self._disturbed_frames % SEARCH_EVERY == 0:
            fitting = self._fitting_without(field_t, deviation_t)
            if len(fitting) == 1:
                ((sensor, estimate),) = fitting.items()
                self._last, self._disturbed_frames = estimate.state, 0
                used[sensor] = False
                reason = f"sensor {sensor + 1} contradicts the others (χ² {whole.chi2:.0f} with it): left out"
                return Track(estimate, used, "degraded", reason)
            self._verdict = self._judge(whole, list(fitting))
        self._last = self._rest
        self._disturbed_frames += 1
        health, reason = self._verdict
        return Track(whole if health == "disturbed" else None, used, health, reason)

    def _fitting_without(self, field_t: Array, deviation_t: Array) -> dict[int, PoseEstimate]:
        """Sensor → the estimate that fits without it, for every sensor whose absence lets the others agree."""
        fitting = {}
        if np.isfinite(field_t).all(axis=1).sum() > FEWEST_SENSORS:
            for sensor in range(len(field_t)):
                others = field_t.copy()
                others[sensor] = np.nan
                estimate = self._solve(others, deviation_t)
                if self._fits(estimate):
                    fitting[sensor] = estimate
        return fitting

    def _judge(self, whole: PoseEstimate, fitting: list[int]) -> tuple[TrackHealth, str]:
        """What to say of a frame that no pose explains."""
        if not self._plausible(whole):
            return "lost", "no magnet of this pad explains the field: is the pad mounted, the magnet whole?"
        limit = quantile(FALSE_ALARM, whole.degrees_of_freedom)
        misfit = f"the field does not come from this magnet alone (χ² over {limit:.0f})"
        if fitting:
            named = " or ".join(str(sensor + 1) for sensor in fitting)
            return "lost", f"{misfit}: sensor {named} may be at fault, which is not clear"
        return "disturbed", f"{misfit}: steel, a magnet, or a turned robot"

    def _plausible(self, estimate: PoseEstimate) -> bool:
        return (
            estimate.status is Status.CONVERGED
            and bool(np.linalg.norm(estimate.position_m - self._rest.position_m) < REACH_M)
            and abs(estimate.state.log_moment - self._rest.log_moment) < np.log(MOMENT_FACTOR)
        )

    def _fits(self, estimate: PoseEstimate) -> bool:
        return self._plausible(estimate) and estimate.chi2 < quantile(FALSE_ALARM, estimate.degrees_of_freedom)


def _listed(sensors: NDArray[np.bool_]) -> str:
    numbers = ", ".join(str(sensor + 1) for sensor in np.flatnonzero(sensors))
    return f"sensor {numbers}"
