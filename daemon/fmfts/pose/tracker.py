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
        self._suspect: int | None = None

    def update(self, field_t: Array, deviation_t: Array) -> Track:
        """field_t (N, 3): the magnet's field in sensor axes, NaN where there is none; deviation_t (N, 3)."""
        used = np.isfinite(field_t)
        whole: NDArray[np.bool_] = np.asarray(used.all(axis=1), dtype=np.bool_)
        if whole.sum() < FEWEST_SENSORS:
            self._last = self._rest
            return Track(None, used, "lost", f"{_listed(~whole)} silent or saturated: fewer than three are left")
        estimate = self._solve(field_t, deviation_t)
        if self._fits(estimate):
            self._suspect = None
            self._last = estimate.state
            if whole.all():
                return Track(estimate, used, "ok", "")
            return Track(estimate, used, "degraded", f"{_listed(~whole)} silent or saturated: left out")
        return self._without_one(field_t, deviation_t, estimate)

    def _solve(self, field_t: Array, deviation_t: Array) -> PoseEstimate:
        """From the last pose; if that does not fit, from rest as well."""
        estimate = solve(field_t, self._pad, self._last, deviation_t=deviation_t, free=FREE_PAPER)
        if self._fits(estimate) or self._last is self._rest:
            return estimate
        again = solve(field_t, self._pad, self._rest, deviation_t=deviation_t, free=FREE_PAPER)
        better = again.status is Status.CONVERGED and not again.chi2 >= estimate.chi2
        return again if better else estimate

    def _without_one(self, field_t: Array, deviation_t: Array, whole_estimate: PoseEstimate) -> Track:
        """The frame without the one sensor that explains its misfit; `disturbed` where none or several would."""
        used = np.isfinite(field_t)
        candidates = [sensor for sensor in range(len(field_t)) if used[sensor].any()]
        if self._suspect in candidates:
            candidates.remove(self._suspect)
            candidates.insert(0, self._suspect)
        fitting: list[tuple[int, PoseEstimate]] = []
        if used.all(axis=1).sum() > FEWEST_SENSORS:
            for sensor in candidates:
                rest_of = field_t.copy()
                rest_of[sensor] = np.nan
                estimate = self._solve(rest_of, deviation_t)
                if self._fits(estimate):
                    fitting.append((sensor, estimate))
        if len(fitting) == 1:
            sensor, estimate = fitting[0]
            self._suspect, self._last = sensor, estimate.state
            used[sensor] = False
            reason = f"sensor {sensor + 1} contradicts the others (χ² {whole_estimate.chi2:.0f} with it): left out"
            return Track(estimate, used, "degraded", reason)
        self._last = self._rest
        if not self._plausible(whole_estimate):
            reason = "no magnet of this pad explains the field: is the pad mounted, the magnet whole?"
            return Track(None, used, "lost", reason)
        limit = quantile(FALSE_ALARM, whole_estimate.degrees_of_freedom)
        reason = f"the field does not come from this magnet alone (χ² {whole_estimate.chi2:.0f}, limit {limit:.0f})"
        if len(fitting) > 1:
            named = " or ".join(str(sensor + 1) for sensor, _ in fitting)
            return Track(None, used, "lost", f"{reason}: sensor {named} may be at fault, which is not clear")
        return Track(whole_estimate, used, "disturbed", f"{reason}: steel, a magnet, or a turned robot")

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
