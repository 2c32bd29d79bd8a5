"""What lasts: the judgement of many frames over the one that each frame passes by itself."""

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
from fmfts.pose.innovation import Finding, MeanResiduals, MeanResidualsMemory
from fmfts.pose.model import predict
from fmfts.pose.problem import Part, Parts, magnet_rows, measurement_rows
from fmfts.pose.solver import PoseEstimate
from fmfts.pose.state import AMBIENT, LOG_MOMENT, State

Array = NDArray[np.float64]
TrackHealth = Literal["ok", "degraded", "disturbed", "lost"]

# Fewer whole sensors than this leave poses that fit as well as the true one.
FEWEST_SENSORS = 3


@dataclass(slots=True)
class ResidualMonitorMemory:
    """finding: what is wrong, None while nothing is. heard: sensors that single frames blamed since."""

    residuals: MeanResidualsMemory
    finding: Finding | None = None
    heard: set[int] = field(default_factory=set)


class ResidualMonitor:
    """One pad's mean residuals. blamed: the sensor that is to be left out, None where there is none."""

    def __init__(self, pad: Pad, rest: State, parts: Parts, errors: SensorErrors) -> None:
        """parts: of the scene's model."""
        self._rest = rest
        self._errors = errors.lasting
        self._pad = pad
        self._rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, 1.0)
        self._magnets = magnet_rows(pad.magnet)
        self._unknown = np.isin(parts, (Part.FREE, Part.PRIOR))
        # The parts that no unknown of the scene follows, and a field from elsewhere has.
        self._foreign = np.flatnonzero((parts == Part.FIXED) & (FOREIGN_DEVIATION > 0.0))
        self._innovations = MeanResiduals(errors.noise_t)
        self.memory = ResidualMonitorMemory(self._innovations.memory)
        self._ambient_is_known = bool(parts[AMBIENT.start] == Part.FIXED)

    @property
    def blamed(self) -> int | None:
        return None if self.memory.finding is None else self.memory.finding.sensor

    @property
    def misfit(self) -> float:
        """By how much variances are larger than they seem, as far as what lasts tells; 1 where nothing does."""
        return self.memory.residuals.lasting_misfit

    @property
    def _clearly_heard(self) -> bool:
        return len(self.memory.heard) == 1

    def recall(self, memory: ResidualMonitorMemory) -> None:
        self.memory, self._innovations.memory = memory, memory.residuals

    def resumed(self, was_sound: bool) -> None:
        """The compiled path went on, and a mean was sound meanwhile or was not."""
        if was_sound:
            self.memory.heard.clear()

    def confirms(self, sensor: int) -> bool:
        """Whether a frame that by itself blames this sensor is to be believed.

        At rest a drifting scene leaves four directions of parity, and in them the same axis of opposite sensors, and
        the z axes of all, look alike: the frame names one by the ambient field before it. That is worth something at
        the start of a fault, and nothing once the field has been learnt from the faulty sensor.
        """
        if self._ambient_is_known or self.memory.residuals.sound:
            self.memory.heard.add(sensor)
        return sensor in self.memory.heard

    def look(self, field_t: Array, lasting_t: Array, nearest: PoseEstimate | None, moment_deviation: float) -> None:
        """Add the frame's residuals to the mean, and see now and then what it says.

        field_t, lasting_t (N, 3): all that was measured, and the lasting part of its deviation. nearest: the estimate
        that comes nearest to the frame, None where none makes sense.
        """
        if nearest is None:
            self._innovations.forget()
            return
        change = change_since(self._rest, nearest.state)
        if not self._innovations.push(field_t - self._predicted(nearest.state), lasting_t, change):
            return
        _, jacobian = predict(self._rows, self._magnets, nearest.state)
        tolerated = jacobian[:, [LOG_MOMENT]] * moment_deviation
        if self._errors is not None:
            mean = self.memory.residuals.change
            tolerated = np.hstack([tolerated, self._errors.at(mean[:5], mean[5:])])
        found = self._innovations.judge(
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

    def told(self, health: TrackHealth, reason: str) -> tuple[TrackHealth, str] | None:
        """What is to be said instead of the frame's own verdict; None where that stands."""
        found = self.memory.finding
        if found is None or health not in ("ok", "degraded"):
            return None
        if found.sensor is not None:
            return "degraded", f"sensor {found.sensor + 1} contradicts the others, and goes on to: left out"
        if found.foreign:
            return "disturbed", "a weak field that is not this magnet's: steel or a magnet near"
        if self._clearly_heard and health == "degraded":
            return None
        named = " or ".join(str(sensor + 1) for sensor in found.suspects)
        return "lost", f"sensor {named} is a little off, which one is not clear"

    def _predicted(self, state: State) -> Array:
        """(N, 3) in sensor axes."""
        sensors, strength = self._pad.sensors, self._pad.magnet.strength_t_m3 * exp(state.log_moment)
        octupole_m2 = self._pad.magnet.modelled_octupole_m2
        field = dipole_field(sensors.position_m, state.position_m, state.axis, strength, octupole_m2)
        return sensors.to_sensor(field + state.ambient_t)


def without(field_t: Array, sensor: int | None) -> Array:
    """The field (N, 3) without one sensor, if enough others are left."""
    if sensor is None:
        return field_t
    left = field_t.copy()
    left[sensor] = np.nan
    return left if np.isfinite(left).all(axis=1).sum() >= FEWEST_SENSORS else field_t
