"""Follows one magnet from frame to frame, and says when it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import product
from fmfts.pad import Pad
from fmfts.pose.field_errors import SensorErrors
from fmfts.pose.foreign_field import with_foreign_field
from fmfts.pose.gate import FALSE_ALARM, LOG_MOMENT_REACH, STRONGER, fits, is_plausible, probability
from fmfts.pose.neighbour import NeighbourEstimate, joined, their_magnets, without_neighbours
from fmfts.pose.problem import Part, Prior, Status
from fmfts.pose.residual_monitor import FEWEST_SENSORS, ResidualMonitor, TrackHealth, without
from fmfts.pose.solver import PoseEstimate, solve
from fmfts.pose.state import LOG_MOMENT, SIZE, State
from fmfts.pose.track import Track, TrackerMemory
from fmfts.pose.tracking_model import TrackingModel

Array = NDArray[np.float64]

STEEL_ABOVE = (
    "the magnet looks {stronger:.0%} stronger than its baseline says: steel touches the pad or is near it, or it is "
    "another magnet: then record `fmfts-daemon baseline --rest --replaced`"
)
# The mean of residuals shows 20 nT, and offsets of chips drift by some 10 nT/K: from here on they may be what it shows.
WARMED_K = 5.0
OR_DRIFTED = (
    "; or offsets of chips drifted, as the pad is over {:g} K from its baseline's temperature: record --rest again"
)
OR_STEEL = (
    "; or steel or a magnet is near, as [pad.scene] says that it may be. If this stays without it, run selftest, and "
    "look at that sensor's wires"
)
NOTHING_SAID: Mapping[int, str] = MappingProxyType({})
# Solve to a thousandth of a deviation: before rest is recorded, deviations include the mounting's tolerances (0.4 mm).
STOP_TRACKING = 1e-6
# While a disturbance lasts, the search for a single faulty sensor is repeated once in so many frames. It is slow: it
# takes many solves, and they converge slowly because none of them fits.
SEARCH_EVERY = 8
# Misfit is averaged over so many frames: a fault shows within 40 ms, even before it is found, and the deviations of
# healthy frames become half a per cent wider.
MISFIT_FRAMES = 8


class Tracker:
    """Solves each frame from the last good one, gates it by χ², and finds and leaves out one faulty sensor."""

    def __init__(
        self,
        pad: Pad,
        rest: State,
        model: TrackingModel,
        rest_temperature_c: float | None = None,
        errors: SensorErrors | None = None,
    ) -> None:
        """errors: those of healthy sensors; without them, the tracker does not look for small faults that last."""
        self._pad = pad
        self._monitor = None if errors is None else ResidualMonitor(pad, rest, model.parts, errors)
        self._strongest = LOG_MOMENT_REACH if errors is None else STRONGER
        self._nearest: PoseEstimate | None = None  # the best plausible estimate of this frame
        self._rest = rest
        self._model = model
        self._has_prior = model.has_prior
        self._rest_temperature_c = rest_temperature_c
        covariance, unread_variance = np.diag(model.initial), square(model.moment_per_k * model.unread_warming_k)
        covariance[LOG_MOMENT, LOG_MOMENT] += unread_variance
        watch = None if self._monitor is None else self._monitor.memory
        self.memory = TrackerMemory(rest, covariance, unread_variance, watch)
        self._neighbours: Sequence[NeighbourEstimate] = ()
        self._missing: Mapping[int, str] = NOTHING_SAID

    @property
    def _moment_deviation(self) -> float:
        return float(np.sqrt(self.memory.covariance[LOG_MOMENT, LOG_MOMENT]))

    @property
    def ambient_t(self) -> Array:
        """Ambient field (N, 3) T of the last good frame, in sensor axes."""
        ambient_t: Array = product(self.memory.state.ambient_t, self._pad.sensors.axes)
        return ambient_t

    @property
    def can_be_handed_over(self) -> bool:
        """Whether the fast path may go on: the last frame was good, a sensor at fault is found or none, and the
        temperature is known."""
        if self.memory.unread_variance > 0.0 and self._rest_temperature_c is not None:
            return False
        if self.memory.since_good_s != 0.0 or self._monitor is None:
            return False
        if self._model.steel_nearby and self._monitor.blamed is not None:
            return False
        return self._monitor.memory.finding is None or self._monitor.blamed is not None

    @property
    def blamed(self) -> int | None:
        """The sensor that is left out because it contradicts the others."""
        return None if self._monitor is None else self._monitor.blamed

    def resumed(self, was_sound: bool) -> None:
        """Note that the fast path went on with the memory, and that all its frames were good."""
        self.memory.since_good_s = 0.0
        if self._monitor is not None:
            self._monitor.resumed(was_sound)

    def recall(self, memory: TrackerMemory) -> None:
        """Continue from another tracker's memory of the same pad, baseline and scene."""
        self.memory = memory
        if self._monitor is not None and memory.watch is not None:
            self._monitor.recall(memory.watch)

    def update(
        self,
        field_t: Array,
        deviation_t: Array,
        elapsed_s: float = 0.0,
        temperature_c: float | None = None,
        lasting_t: Array | None = None,
        neighbours: Sequence[NeighbourEstimate] = (),
        missing: Mapping[int, str] = NOTHING_SAID,
    ) -> Track:
        """Judge one frame.

        field_t (N, 3): the magnet's field in sensor axes, NaN where it was not measured. deviation_t (N, 3). lasting_t
        (N, 3): the part of deviation_t that averaging does not reduce, and that `errors` do not contain. elapsed_s:
        since the last frame. temperature_c: of the pad; None keeps the last one. neighbours: felt magnets.
        missing: sensor → what is wrong with it, for the reason, where field_t is NaN.
        """
        track = self._judged(field_t, deviation_t, elapsed_s, temperature_c, lasting_t, neighbours, missing)
        if not self._model.steel_nearby or track.health != "degraded" or not (np.isfinite(field_t) & ~track.used).any():
            return track
        return Track(None, track.used, "disturbed", f"{track.reason}{OR_STEEL}")

    def _judged(
        self,
        field_t: Array,
        deviation_t: Array,
        elapsed_s: float,
        temperature_c: float | None,
        lasting_t: Array | None,
        neighbours: Sequence[NeighbourEstimate],
        missing: Mapping[int, str],
    ) -> Track:
        """See `update`. A sensor that contradicts the others is left out."""
        self._neighbours, self._missing = neighbours, missing
        self.memory.since_good_s += max(elapsed_s, 0.0)
        self._nearest = None
        if self._monitor is None or lasting_t is None:
            return self._follow(field_t, deviation_t, temperature_c)
        blamed = self._monitor.blamed
        track = self._follow(without(field_t, blamed), deviation_t, temperature_c)
        overruling = self._monitor.overruling(track.health, track.reason)
        alone_t, nearest = without_neighbours(field_t, self._nearest, neighbours, self._pad.sensors)
        self._monitor.observe(alone_t, lasting_t, nearest, self._moment_deviation)
        if overruling is None:
            return track
        health, reason = overruling
        warmed_k = abs((temperature_c or 0.0) - (self._rest_temperature_c or 0.0))
        if health != "degraded" and None not in (temperature_c, self._rest_temperature_c) and warmed_k > WARMED_K:
            reason += OR_DRIFTED.format(WARMED_K * (warmed_k // WARMED_K))
        is_left_out = health == "degraded" and track.is_steady and blamed is not None and self._monitor.blamed == blamed
        return Track(
            track.estimate if health == "degraded" else None, track.used, health, reason, is_steady=is_left_out
        )

    def _follow(self, field_t: Array, deviation_t: Array, temperature_c: float | None) -> Track:
        """The verdict on this frame alone."""
        used = np.isfinite(field_t)
        whole: NDArray[np.bool_] = np.asarray(used.all(axis=1), dtype=np.bool_)
        if whole.sum() < FEWEST_SENSORS:
            return Track(None, used, "lost", f"{self._why_not(whole)}: fewer than three sensors are left")
        prior = self._predicted(temperature_c)
        estimate = self._solve(field_t, deviation_t, prior)
        if not self._fits(estimate):
            return self._explain(field_t, deviation_t, prior, estimate)
        published = self._accept(estimate)
        if whole.all():
            return Track(published, used, "ok", "", is_steady=True)
        return Track(published, used, "degraded", f"{self._why_not(whole)}: left out", is_steady=True)

    def _fits(self, estimate: PoseEstimate) -> bool:
        return fits(estimate, self._rest, self._strongest)

    def _why_not(self, whole: NDArray[np.bool_]) -> str:
        """What is wrong with the sensors that are not `whole` (N,)."""
        blamed = None if self._monitor is None else self._monitor.blamed
        what = {sensor: self._missing.get(sensor, "without a new sample") for sensor in np.flatnonzero(~whole).tolist()}
        if blamed in what and blamed not in self._missing:
            what[blamed] = "at odds with the others"
        return "; ".join(f"sensor {sensor + 1} is {why}" for sensor, why in what.items())

    def _predicted(self, temperature_c: float | None) -> Prior:
        """The prior of this frame: the last good state at this temperature, widened by time and warming since then."""
        moment, self._new_warmth = self.memory.state.log_moment, self.memory.warmth_variance
        if temperature_c is not None and self._rest_temperature_c is not None:
            warmer_k = temperature_c - self._rest_temperature_c
            self._learn_first_temperature(warmer_k)
            self._new_warmth = max(square(self._model.moment_per_k_deviation * warmer_k), self.memory.warmth_variance)
            if self._model.parts[LOG_MOMENT] == Part.CONSIDERED:
                moment = self._rest.log_moment + self._model.moment_per_k * warmer_k
        covariance = self.memory.covariance + np.diag(self._model.walk_per_s * self.memory.since_good_s)
        covariance[LOG_MOMENT, LOG_MOMENT] += self._new_warmth - self.memory.warmth_variance
        return Prior(replace(self.memory.state, log_moment=moment), covariance)

    def _learn_first_temperature(self, warmer_k: float) -> None:
        """Remove the unknown warming from the error of the moment, and of all that correlates with it: a Kalman update
        by a part of the error that is now exactly known."""
        if self.memory.unread_variance > 0.0:
            memory = self.memory
            by_moment = memory.covariance[:, LOG_MOMENT] / memory.covariance[LOG_MOMENT, LOG_MOMENT]
            memory.state = memory.state.stepped(by_moment * (self._model.moment_per_k * warmer_k))
            memory.covariance = memory.covariance - memory.unread_variance * np.outer(by_moment, by_moment)
            memory.unread_variance = 0.0

    def _accept(self, estimate: PoseEstimate) -> PoseEstimate:
        """Continue from this estimate. Returns it, its covariance widened by the recent misfit.

        Residuals that are larger than their deviations show an error that is not found yet; the pose's errors are then
        larger by the same factor. R. T. Birge, "The calculation of errors by the method of least squares", Phys. Rev.
        40 (1932) 207.
        """
        self.memory.misfit += (estimate.chi2 / estimate.degrees_of_freedom - self.memory.misfit) / MISFIT_FRAMES
        self.memory.state, self._nearest = replace(estimate.state, neighbours=()), estimate
        self.memory.covariance = estimate.covariance[:SIZE, :SIZE]
        self.memory.warmth_variance = self._new_warmth
        self.memory.since_good_s = 0.0
        self.memory.disturbed_frames = 0
        lasting = 1.0 if self._monitor is None else self._monitor.misfit
        return replace(estimate, covariance=max(self.memory.misfit, lasting) * estimate.covariance)

    def _solve(self, field_t: Array, deviation_t: Array, prior: Prior, gradient: bool = False) -> PoseEstimate:
        """Solve from the last pose. If that does not fit, also from rest, in each frame that searches."""
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
            neighbours=their_magnets(self._neighbours),
            stop_chi2=STOP_TRACKING,
        )

    def _explain(self, field_t: Array, deviation_t: Array, prior: Prior, whole: PoseEstimate) -> Track:
        """The verdict on a frame that does not fit: `degraded` if one sensor is to blame, or `disturbed`, or `lost`."""
        used = np.isfinite(field_t)
        if fits(whole, self._rest):
            self.memory.disturbed_frames += 1
            stronger = exp(whole.state.log_moment - self._rest.log_moment) - 1.0
            return Track(None, used, "disturbed", STEEL_ABOVE.format(stronger=stronger), stronger=True)
        self._nearest = whole if is_plausible(whole, self._rest) else None
        if self.memory.disturbed_frames % SEARCH_EVERY == 0:
            fitting = self._fitting_without(field_t, deviation_t, prior)
            with_gradient = self._solve(field_t, deviation_t, prior, gradient=True)
            foreign = probability(with_gradient, self._rest)
            fitting = {sensor: one for sensor, one in fitting.items() if probability(one, self._rest) > foreign}
            if len(fitting) == 1:
                ((sensor, estimate),) = fitting.items()
                if self._monitor is not None and not self._monitor.confirms(sensor):
                    return Track(None, used, "lost", f"sensor {sensor + 1} may be at fault, or the field has turned")
                used[sensor] = False
                reason = f"sensor {sensor + 1} contradicts the others (χ² {whole.chi2:.0f} with it): left out"
                return Track(self._accept(estimate), used, "degraded", reason)
            complete = np.asarray(used.all(axis=1), dtype=np.bool_)
            self.memory.verdict = self._judge(whole, list(fitting), foreign > FALSE_ALARM, complete)
        self.memory.disturbed_frames += 1
        health, reason = self.memory.verdict
        return Track(None, used, health, reason)

    def _fitting_without(self, field_t: Array, deviation_t: Array, prior: Prior) -> dict[int, PoseEstimate]:
        """Sensor → the estimate without it, for each sensor without which the others fit."""
        fitting = {}
        if np.isfinite(field_t).all(axis=1).sum() > FEWEST_SENSORS:
            for sensor in range(len(field_t)):
                others = field_t.copy()
                others[sensor] = np.nan
                estimate = self._solve(others, deviation_t, prior)
                if self._fits(estimate):
                    fitting[sensor] = estimate
        return fitting

    def _judge(
        self, whole: PoseEstimate, fitting: list[int], foreign: bool, complete: NDArray[np.bool_]
    ) -> tuple[TrackHealth, str]:
        """Health and reason of a frame that no pose explains. foreign: a foreign field would explain it. complete (N,):
        the sensors that were used. Two faulty sensors of four look like a foreign field, and one of three does."""
        if fitting:
            named = " or ".join(str(sensor + 1) for sensor in fitting)
            return "lost", f"sensor {named} may be at fault: it is not clear which"
        if not (foreign or is_plausible(whole, self._rest)):
            return "lost", "no pose of this magnet explains the field: is the pad mounted, and is the magnet whole?"
        alone = "the field does not come from this magnet alone: steel, a magnet, or a turned robot"
        # A sensor that was left out, as it contradicted the others, is not to blame: without it they do not fit either.
        blamed, told = self.blamed, complete.copy()
        if blamed is not None and blamed not in self._missing:
            told[blamed] = True
        if told.all():
            return "disturbed", f"{alone}; or two sensors are wrong (run selftest)"
        return "disturbed", f"{self._why_not(told)}, and {alone}; or another sensor is wrong (run selftest)"
