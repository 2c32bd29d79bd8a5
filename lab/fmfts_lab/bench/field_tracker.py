"""The daemon's tracker on fields that are given, without counts, baseline and contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.arithmetic.elementary import exp, square
from fmfts.common.chi2 import quantile
from fmfts.common.record import Record
from fmfts.pad import Array, Pad
from fmfts.pipeline import _pad
from fmfts.pipeline.first_memory import FIRST
from fmfts.pipeline.parameters import hidden_gradient_fields
from fmfts.pose import FREE_FIELD, Part, PoseEstimate, SensorErrors, State, Status, TrackingModel
from fmfts.pose.gates import FALSE_ALARM, FALSE_LINE, FALSE_MEAN_ALARM, MOVED_MISFIT, SOUND
from fmfts.pose.hidden_gradient import HiddenGradient
from fmfts.pose.state import LOG_MOMENT, SIZE


@dataclass(frozen=True, slots=True)
class Tracked:
    """health, reason, sensors_ok: as in a message. estimate: None unless health is ok or degraded."""

    health: str
    reason: str
    sensors_ok: int
    estimate: PoseEstimate | None


class FieldTracker:
    """errors: those of healthy sensors; without them, small lasting faults are not searched."""

    def __init__(
        self,
        pad: Pad,
        rest: State,
        model: TrackingModel,
        rest_temperature_c: float = np.nan,
        errors: SensorErrors | None = None,
        hidden: HiddenGradient | None = None,
    ) -> None:
        """hidden: the pad's hidden gradient; without it, the ambient field is not searched for a foreign one."""
        values, free = 3 * len(pad.sensors), int((model.parts == Part.FREE).sum())
        estimated = int(np.isin(model.parts, (Part.FREE, Part.PRIOR)).sum())
        self._unknowns, self._remanence_t = free, pad.magnet.remanence_t
        self.parameters, self.memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
        self._errors: memoryview | None = None
        self.parameters.fill(
            {
                "sensors": len(pad.sensors),
                "at_rest": errors is not None,
                "steel_nearby": model.steel_nearby,
                "place_m": pad.sensors.position_m,
                "direction": pad.sensors.axes.transpose(0, 2, 1),
                "strength_t_m3": pad.magnet.strength_t_m3,
                "octupole_m2": pad.magnet.modelled_octupole_m2,
                "part": model.parts[:SIZE],
                "walk_per_s": model.walk_per_s[:SIZE],
                "moment_per_k": model.moment_per_k,
                "moment_per_k_deviation": model.moment_per_k_deviation,
                "unread_warming_k": model.unread_warming_k,
                "rest_temperature_c": rest_temperature_c,
                "rest": rest.vector(),
                "gate_chi2": _quantiles(FALSE_ALARM, values - free + 1),
                "surprising_chi2": _quantiles(SOUND, values - free + 1),
                "line_chi2": quantile(FALSE_LINE, 6),
                "motion_chi2": _quantiles(MOVED_MISFIT, values - len(FREE_FIELD)),
                "alarm_chi2": _quantiles(FALSE_MEAN_ALARM, values - estimated),
                "sound_chi2": _quantiles(SOUND, values - estimated),
            }
        )
        if errors is not None:
            self.parameters.put("noise_t", errors.noise_t)
            if errors.lasting is not None:
                self._errors = np.ascontiguousarray(errors.lasting.table).reshape(-1).data
        self.parameters.fill({"strongest_foreign_t": np.inf, "reference_t": np.full(3, np.nan)})
        if hidden is not None:
            self.parameters.fill(hidden_gradient_fields(hidden))
        covariance, unread_variance = np.diag(model.initial), square(model.moment_per_k * model.unread_warming_k)
        covariance[LOG_MOMENT, LOG_MOMENT] += unread_variance
        first = {"state": rest.vector(), "covariance": covariance, "unread_variance": unread_variance}
        self.memory.fill(FIRST | first)

    def update(
        self,
        field_t: Array,
        deviation_t: Array,
        elapsed_s: float = 0.0,
        temperature_c: float = np.nan,
        lasting_t: Array | None = None,
    ) -> Tracked:
        """field_t, deviation_t, lasting_t (N, 3): see `_pad.track_field`."""
        lasting = np.zeros(field_t.shape) if lasting_t is None else lasting_t
        covariance = np.zeros((SIZE, SIZE))
        field, deviation, lasting_too = (
            np.ascontiguousarray(one, dtype=float).ravel().data for one in (field_t, deviation_t, lasting)
        )
        health, reason, used, has_estimate, chi2, residual_t = _pad.track_field(
            self.parameters.buffer,
            self.memory.buffer,
            field,
            deviation,
            lasting_too,
            covariance.ravel().data,
            elapsed_s,
            temperature_c,
            self._errors,
        )
        if not has_estimate:
            return Tracked(health, reason, used, None)
        state, strength = State.from_vector(self.memory["state"].copy()), self._remanence_t
        numbers = chi2, 3 * used.bit_count(), self._unknowns, residual_t, 0, Status.CONVERGED, np.full(SIZE, np.nan)
        remanence_t = strength * exp(state.log_moment)
        return Tracked(health, reason, used, PoseEstimate(state, covariance, *numbers, remanence_t=remanence_t))


def _quantiles(probability: float, most: int) -> Array:
    return np.array([np.nan] + [quantile(probability, freedom) for freedom in range(1, most + 1)])
