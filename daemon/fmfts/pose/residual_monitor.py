"""Watches the mean residuals of many frames, and can overrule the verdict on a single frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp
from fmfts.pad import Pad
from fmfts.pose.dipole import dipole_field
from fmfts.pose.field_errors import SensorErrors, change_since
from fmfts.pose.foreign_field import FOREIGN_DEVIATION
from fmfts.pose.mean_residuals import Finding, MeanResiduals, MeanResidualsMemory
from fmfts.pose.model import predict
from fmfts.pose.problem import Part, Parts, magnet_rows, measurement_rows
from fmfts.pose.solver import PoseEstimate
from fmfts.pose.state import AMBIENT, LOG_MOMENT, State

Array = NDArray[np.float64]
TrackHealth = Literal["ok", "degraded", "disturbed", "lost"]

# With fewer complete sensors than this, wrong poses fit as well as the true one.
FEWEST_SENSORS = 3


@dataclass(slots=True)
class ResidualMonitorMemory:
    """finding: what is wrong, None if nothing is. heard: the sensors that single frames blamed since all was sound."""

    residuals: MeanResidualsMemory
    finding: Finding | None = None
    heard: set[int] = field(default_factory=set)


class ResidualMonitor:
    """Judges the mean residuals of one pad."""

    def __init__(self, pad: Pad, rest: State, parts: Parts, errors: SensorErrors) -> None:
        """parts (SIZE,): see `TrackingModel`. errors: those of healthy sensors."""
        self._rest = rest
        self._errors = errors.lasting
        self._pad = pad
        self._rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, 1.0)
        self._magnets = magnet_rows(pad.magnet)
        self._unknown = np.isin(parts, (Part.FREE, Part.PRIOR))
        # Parts of a foreign field that the scene's model holds fixed.
        self._foreign = np.flatnonzero((parts == Part.FIXED) & (FOREIGN_DEVIATION > 0.0))
        self._mean_residuals = MeanResiduals(errors.noise_t)
        self.memory = ResidualMonitorMemory(self._mean_residuals.memory)
        self._ambient_is_known = bool(parts[AMBIENT.start] == Part.FIXED)

    @property
    def blamed(self) -> int | None:
        """The sensor that must be left out, if any."""
        return None if self.memory.finding is None else self.memory.finding.sensor

    @property
    def misfit(self) -> float:
        """The factor by which lasting residuals widen the variances, at least 1."""
        return self.memory.residuals.lasting_misfit

    @property
    def _single_frames_agree(self) -> bool:
        return len(self.memory.heard) == 1

    def recall(self, memory: ResidualMonitorMemory) -> None:
        self.memory, self._mean_residuals.memory = memory, memory.residuals

    def resumed(self, was_sound: bool) -> None:
        """Note that the fast path went on. was_sound: the mean residuals were sound at some judgement."""
        if was_sound:
            self.memory.heard.clear()

    def confirms(self, sensor: int) -> bool:
        """Whether to believe a single frame that blames this sensor.

        In a drifting scene at rest, parity space has only four dimensions. In it, faults of the same axis of opposite
        sensors look alike, and so do those of all z axes: a frame tells them apart only by the last ambient field. That
        works at the start of a fault, but not after the ambient field was estimated from the faulty sensor.
        """
        if self._ambient_is_known or self.memory.residuals.sound:
            self.memory.heard.add(sensor)
        return sensor in self.memory.heard

    def observe(self, field_t: Array, lasting_t: Array, nearest: PoseEstimate | None, moment_deviation: float) -> None:
        """Add the frame's residuals to the mean, and judge the mean from time to time.

        field_t (N, 3): the measured field, also of blamed sensors. lasting_t (N, 3): the part of its deviation that
        averaging does not reduce. nearest: the best plausible estimate of the frame; None clears the mean.
        """
        if nearest is None:
            self._mean_residuals.forget()
            return
        change = change_since(self._rest, nearest.state)
        if not self._mean_residuals.push(field_t - self._predicted(nearest.state), lasting_t, change):
            return
        _, jacobian = predict(self._rows, self._magnets, nearest.state)
        tolerated = jacobian[:, [LOG_MOMENT]] * moment_deviation
        if self._errors is not None:
            mean = self.memory.residuals.change
            tolerated = np.hstack([tolerated, self._errors.at(mean[:5], mean[5:])])
        found = self._mean_residuals.judge(
            jacobian[:, self._unknown],
            tolerated,
            jacobian[:, self._foreign] * FOREIGN_DEVIATION[self._foreign],
            forgiving=self.memory.finding is not None,
        )
        heard = self.memory.heard
        if self.memory.residuals.sound:
            heard.clear()
        elif found is not None and found.sensor is None and len(heard) == 1 and heard <= set(found.suspects):
            found = replace(found, sensor=min(heard))
        self.memory.finding = found

    def overruling(self, health: TrackHealth, reason: str) -> tuple[TrackHealth, str] | None:
        """The health and reason that replace those of the single frame; None if those stand."""
        found = self.memory.finding
        if found is None or health not in ("ok", "degraded"):
            return None
        if found.sensor is not None:
            return "degraded", f"sensor {found.sensor + 1} still contradicts the others: it is left out"
        if found.foreign:
            # Where the scene holds the ambient field fixed, a robot that turned is a uniform foreign field.
            turned = ", or the robot has turned" if self._ambient_is_known else ""
            return "disturbed", f"a weak foreign field: steel or another magnet is near{turned}"
        if self._single_frames_agree and health == "degraded":
            return None
        named = " or ".join(str(sensor + 1) for sensor in found.suspects)
        if len(found.suspects) == 1:  # no other sensor explains it as well, so what is left is no sensor
            return "lost", f"sensor {named} is a little off, or a weak foreign field is near: it is not clear which"
        return "lost", f"sensor {named} is a little off: it is not clear which one"

    def _predicted(self, state: State) -> Array:
        """The field (N, 3) T that `state` predicts, in sensor axes."""
        sensors, strength = self._pad.sensors, self._pad.magnet.strength_t_m3 * exp(state.log_moment)
        octupole_m2 = self._pad.magnet.modelled_octupole_m2
        field = dipole_field(sensors.position_m, state.position_m, state.axis, strength, octupole_m2)
        return sensors.to_sensor(field + state.ambient_t)


def without(field_t: Array, sensor: int | None) -> Array:
    """The field (N, 3) with NaN for one sensor, if enough others remain; else unchanged."""
    if sensor is None:
        return field_t
    left = field_t.copy()
    left[sensor] = np.nan
    return left if np.isfinite(left).all(axis=1).sum() >= FEWEST_SENSORS else field_t
