"""Follows one magnet from frame to frame, and says when it cannot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.matrix import length, product
from fmfts.common.chi2 import quantile, survival
from fmfts.pad import Pad
from fmfts.pose.field_errors import SensorErrors
from fmfts.pose.foreign_field import with_foreign_field
from fmfts.pose.neighbour import NeighbourEstimate, joined, without_neighbours
from fmfts.pose.problem import Part, Prior, Status
from fmfts.pose.residual_monitor import FEWEST_SENSORS, ResidualMonitor, ResidualMonitorMemory, TrackHealth, without
from fmfts.pose.solver import PoseEstimate, solve
from fmfts.pose.state import LOG_MOMENT, POSITION, SIZE, State
from fmfts.pose.tracking_model import TrackingModel

Array = NDArray[np.float64]

# Healthy frames that the χ² gate rejects: one in an hour at 220 Hz is 1.3e-6.
FALSE_ALARM = 1e-6
# A thousandth of a deviation: before rest is recorded, deviations hold the mounting's tolerances and are 0.4 mm wide.
STOP_TRACKING = 1e-6
# While a disturbance lasts, the search for a single sensor at fault is repeated once in so many frames: it costs
# solves that take their time, because none of them fits.
SEARCH_EVERY = 8
# Misfit is averaged over so many frames: a fault that is not found yet shows within 40 ms, and what healthy frames
# publish is half a per cent wider for it.
MISFIT_FRAMES = 8
# A magnet further from rest than this, or with a moment three times off, is not the pad's any more.
REACH_M = 8e-3
LOG_MOMENT_REACH = log(3.0)
# A place that is known no better than this is none: contact is not linear over it.
VAGUE_M = 1e-3


@dataclass(frozen=True, slots=True)
class Track:
    """estimate: None unless ok or degraded: a pose that does not fit has no deviations.

    used: (N, 3) axes behind it. reason: empty when ok.
    """

    estimate: PoseEstimate | None
    used: NDArray[np.bool_]
    health: TrackHealth
    reason: str


@dataclass(slots=True)
class TrackerMemory:
    """state, covariance (SIZE, SIZE): of the last good frame, `since_good_s` ago. unread_variance: of the log moment,
    while the pad's temperature has not been read. misfit: χ² over its degrees of freedom, of late. verdict: of the
    last search for what is wrong, which is repeated while `disturbed_frames` goes on."""

    state: State
    covariance: Array
    unread_variance: float
    watch: ResidualMonitorMemory | None
    since_good_s: float = 0.0
    warmth_variance: float = 0.0
    disturbed_frames: int = 0
    misfit: float = 1.0
    verdict: tuple[TrackHealth, str] = ("lost", "")


class Tracker:
    """Levenberg–Marquardt started from the last good frame, gated by χ²; one bad sensor is found and left out.

    Parts with a prior are carried from one good frame to the next; a frame that is not good teaches nothing.
    """

    def __init__(
        self,
        pad: Pad,
        rest: State,
        model: TrackingModel,
        rest_temperature_c: float | None = None,
        errors: SensorErrors | None = None,
    ) -> None:
        """errors: of sensors that are well; without it, faults that are small and last are not looked for."""
        self._pad = pad
        self._watch = None if errors is None else ResidualMonitor(pad, rest, model.parts, errors)
        self._nearest: PoseEstimate | None = None  # to the truth, as far as this frame tells
        self._rest = rest
        self._model = model
        self._has_prior = model.has_prior
        self._rest_temperature_c = rest_temperature_c
        covariance, unread_variance = np.diag(model.initial), square(model.moment_per_k * model.unread_warming_k)
        covariance[LOG_MOMENT, LOG_MOMENT] += unread_variance
        watch = None if self._watch is None else self._watch.memory
        self.memory = TrackerMemory(rest, covariance, unread_variance, watch)
        self._neighbours: Sequence[NeighbourEstimate] = ()

    @property
    def _moment_deviation(self) -> float:
        return float(np.sqrt(self.memory.covariance[LOG_MOMENT, LOG_MOMENT]))

    @property
    def ambient_t(self) -> Array:
        """(N, 3) in sensor axes, of the last good frame: what of the field is not the magnet's."""
        ambient_t: Array = product(self.memory.state.ambient_t, self._pad.sensors.rotation)
        return ambient_t

    @property
    def can_be_handed_over(self) -> bool:
        """To the compiled path: the last frame was good, nothing is found, and the temperature has been read."""
        if self.memory.unread_variance > 0.0 and self._rest_temperature_c is not None:
            return False
        return self.memory.since_good_s == 0.0 and self._watch is not None and self._watch.memory.finding is None

    def resumed(self, was_sound: bool) -> None:
        """The compiled path went on with the memory: all its frames were good."""
        self.memory.since_good_s = 0.0
        if self._watch is not None:
            self._watch.resumed(was_sound)

    def recall(self, memory: TrackerMemory) -> None:
        """Go on from another tracker's memory of the same pad, baseline and scene."""
        self.memory = memory
        if self._watch is not None and memory.watch is not None:
            self._watch.recall(memory.watch)

    def update(
        self,
        field_t: Array,
        deviation_t: Array,
        elapsed_s: float = 0.0,
        temperature_c: float | None = None,
        lasting_t: Array | None = None,
        neighbours: Sequence[NeighbourEstimate] = (),
    ) -> Track:
        """field_t (N, 3): the magnet's field in sensor axes, NaN where there is none; deviation_t (N, 3), of which
        lasting_t is what no averaging takes away and `errors` do not say; elapsed_s since the last frame;
        temperature_c of the pad, None where unknown: then as it was. neighbours: other magnets in the field."""
        self._neighbours = neighbours
        self.memory.since_good_s += max(elapsed_s, 0.0)
        self._nearest = None
        if self._watch is None or lasting_t is None:
            return self._follow(field_t, deviation_t, temperature_c)
        blamed = self._watch.blamed
        track = self._follow(without(field_t, blamed), deviation_t, temperature_c)
        told = self._watch.told(track.health, track.reason)
        alone_t, nearest = without_neighbours(field_t, self._nearest, neighbours, self._pad.sensors)
        self._watch.look(alone_t, lasting_t, nearest, self._moment_deviation)
        if told is None:
            return track
        health, reason = told
        return Track(track.estimate if health == "degraded" else None, track.used, health, reason)

    def _follow(self, field_t: Array, deviation_t: Array, temperature_c: float | None) -> Track:
        """What this frame says by itself."""
        used = np.isfinite(field_t)
        whole: NDArray[np.bool_] = np.asarray(used.all(axis=1), dtype=np.bool_)
        if whole.sum() < FEWEST_SENSORS:
            return Track(None, used, "lost", f"{_listed(~whole)} silent, saturated or stuck: fewer than three are left")
        prior = self._predicted(temperature_c)
        estimate = self._solve(field_t, deviation_t, prior)
        if not self._fits(estimate):
            return self._explain(field_t, deviation_t, prior, estimate)
        published = self._accept(estimate)
        if whole.all():
            return Track(published, used, "ok", "")
        return Track(published, used, "degraded", f"{_listed(~whole)} silent, saturated or stuck: left out")

    def _predicted(self, temperature_c: float | None) -> Prior:
        """The last good state, as warm as last known, as uncertain as time and warmth have made it since."""
        moment, self._new_warmth = self.memory.state.log_moment, self.memory.warmth_variance
        if temperature_c is not None and self._rest_temperature_c is not None:
            warmer_k = temperature_c - self._rest_temperature_c
            self._count_with(warmer_k)
            self._new_warmth = max(square(self._model.moment_per_k_deviation * warmer_k), self.memory.warmth_variance)
            if self._model.parts[LOG_MOMENT] == Part.CONSIDERED:
                moment = self._rest.log_moment + self._model.moment_per_k * warmer_k
        covariance = self.memory.covariance + np.diag(self._model.walk_per_s * self.memory.since_good_s)
        covariance[LOG_MOMENT, LOG_MOMENT] += self._new_warmth - self.memory.warmth_variance
        return Prior(replace(self.memory.state, log_moment=moment), covariance)

    def _count_with(self, warmer_k: float) -> None:
        """The first temperature that is read takes its share of the moment's error away, and of all that went with it:
        a Kalman update by a part of the error that is then known exactly."""
        if self.memory.unread_variance > 0.0:
            memory = self.memory
            by_moment = memory.covariance[:, LOG_MOMENT] / memory.covariance[LOG_MOMENT, LOG_MOMENT]
            memory.state = memory.state.stepped(by_moment * (self._model.moment_per_k * warmer_k))
            memory.covariance = memory.covariance - memory.unread_variance * np.outer(by_moment, by_moment)
            memory.unread_variance = 0.0

    def _accept(self, estimate: PoseEstimate) -> PoseEstimate:
        """Go on from this estimate, and publish it as uncertain as frames of late misfit, or their mean does.

        Where residuals are larger than their deviations say, something is off that is not found yet, and errors are
        larger by as much. R. T. Birge, "The calculation of errors by the method of least squares", Phys. Rev. 40
        (1932) 207.
        """
        self.memory.misfit += (estimate.chi2 / estimate.degrees_of_freedom - self.memory.misfit) / MISFIT_FRAMES
        self.memory.state, self._nearest = replace(estimate.state, neighbours=()), estimate
        self.memory.covariance = estimate.covariance[:SIZE, :SIZE]
        self.memory.warmth_variance = self._new_warmth
        self.memory.since_good_s = 0.0
        self.memory.disturbed_frames = 0
        lasting = 1.0 if self._watch is None else self._watch.misfit
        return replace(estimate, covariance=max(self.memory.misfit, lasting) * estimate.covariance)

    def _solve(self, field_t: Array, deviation_t: Array, prior: Prior, gradient: bool = False) -> PoseEstimate:
        """From the last pose; if that does not fit, from rest as well: at first, and then at every search."""
        estimate = self._solve_from(prior.mean, field_t, deviation_t, prior, gradient)
        if self._fits(estimate) or self.memory.disturbed_frames % SEARCH_EVERY:
            return estimate
        start = replace(prior.mean, position_m=self._rest.position_m, axis=self._rest.axis)
        again = self._solve_from(start, field_t, deviation_t, prior, gradient)
        better = again.status is Status.CONVERGED and not again.chi2 >= estimate.chi2
        return again if better else estimate

    def _solve_from(
        self, start: State, field_t: Array, deviation_t: Array, prior: Prior, gradient: bool
    ) -> PoseEstimate:
        parts = self._model.parts
        if gradient:
            parts, prior = with_foreign_field(parts, prior)
        if self._neighbours:
            start, parts, prior = joined(start, parts, prior, self._neighbours)
        return solve(
            field_t,
            self._pad,
            start,
            deviation_t=deviation_t,
            parts=parts,
            prior=prior if gradient or self._has_prior or self._neighbours else None,
            neighbours=[other.magnet for other in self._neighbours],
            stop_chi2=STOP_TRACKING,
        )

    def _explain(self, field_t: Array, deviation_t: Array, prior: Prior, whole: PoseEstimate) -> Track:
        """A frame that the model does not fit: without the one sensor that is to blame, else `disturbed` or `lost`."""
        used = np.isfinite(field_t)
        self._nearest = whole if self._plausible(whole) else None
        if self.memory.disturbed_frames % SEARCH_EVERY == 0:
            fitting = self._fitting_without(field_t, deviation_t, prior)
            steel = self._solve(field_t, deviation_t, prior, gradient=True)
            outside = self._probability(steel)
            fitting = {sensor: found for sensor, found in fitting.items() if self._probability(found) > outside}
            if len(fitting) == 1:
                ((sensor, estimate),) = fitting.items()
                if self._watch is not None and not self._watch.confirms(sensor):
                    return Track(None, used, "lost", f"sensor {sensor + 1} may be at fault, or the field has turned")
                used[sensor] = False
                reason = f"sensor {sensor + 1} contradicts the others (χ² {whole.chi2:.0f} with it): left out"
                return Track(self._accept(estimate), used, "degraded", reason)
            self.memory.verdict = self._judge(whole, list(fitting), outside > FALSE_ALARM)
        self.memory.disturbed_frames += 1
        health, reason = self.memory.verdict
        return Track(None, used, health, reason)

    def _fitting_without(self, field_t: Array, deviation_t: Array, prior: Prior) -> dict[int, PoseEstimate]:
        """Sensor → the estimate that fits without it, for every sensor whose absence lets the others agree."""
        fitting = {}
        if np.isfinite(field_t).all(axis=1).sum() > FEWEST_SENSORS:
            for sensor in range(len(field_t)):
                others = field_t.copy()
                others[sensor] = np.nan
                estimate = self._solve(others, deviation_t, prior)
                if self._fits(estimate):
                    fitting[sensor] = estimate
        return fitting

    def _judge(self, whole: PoseEstimate, fitting: list[int], uneven: bool) -> tuple[TrackHealth, str]:
        """What to say of a frame that no pose explains."""
        if fitting:
            named = " or ".join(str(sensor + 1) for sensor in fitting)
            return "lost", f"sensor {named} may be at fault, which is not clear"
        if not (uneven or self._plausible(whole)):
            return "lost", "no magnet of this pad explains the field: is the pad mounted, the magnet whole?"
        return "disturbed", "the field does not come from this magnet alone: steel, a magnet, or a turned robot"

    def _plausible(self, estimate: PoseEstimate) -> bool:
        return (
            estimate.status is Status.CONVERGED
            and length(estimate.position_m - self._rest.position_m) < REACH_M
            and float(np.trace(estimate.covariance[POSITION, POSITION])) < square(VAGUE_M)
            and abs(estimate.state.log_moment - self._rest.log_moment) < LOG_MOMENT_REACH
        )

    def _probability(self, estimate: PoseEstimate) -> float:
        """That a healthy frame misfits more than this one; zero where there is no plausible pose."""
        if not self._plausible(estimate):
            return 0.0
        return survival(estimate.chi2, estimate.degrees_of_freedom)

    def _fits(self, estimate: PoseEstimate) -> bool:
        return self._plausible(estimate) and estimate.chi2 < quantile(FALSE_ALARM, estimate.degrees_of_freedom)


def _listed(sensors: NDArray[np.bool_]) -> str:
    numbers = ", ".join(str(sensor + 1) for sensor in np.flatnonzero(sensors))
    return f"sensor {numbers}"
