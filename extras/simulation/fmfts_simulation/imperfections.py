"""Errors of real pads besides their tolerances: the switches `imperfections` and `finger_shape`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array, Magnet
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.finger import Touch, columns
from fmfts_simulation.finger_shape import FingerShape, thimble_field
from fmfts_simulation.imperfect_chips import ImperfectChips
from fmfts_simulation.mounted import MountedPad
from fmfts_simulation.silicone import Silicone

# A magnet that was cast into the silicone by hand, without a jig.
CAST_OFF_M, CAST_TILT_RAD = 1e-3, float(np.deg2rad(5.0))
# Steel screws in the mount, 30 mm away and larger than advised: their effect on a uniform field.
SOFT_IRON = 0.03
TOP_M = 2e-3  # height of the standard pad's top over the magnet's centre


def cast(built: MountedPad, random: np.random.Generator) -> MountedPad:
    """The same pad with its magnet off-centre and tilted by casting. Places of presses still count from its middle."""
    towards, about = random.uniform(0.0, 2.0 * np.pi, 2)
    off_m = CAST_OFF_M * np.array([np.cos(towards), np.sin(towards), 0.0])
    tilted = built.with_magnet_tilted(CAST_TILT_RAD * np.array([np.cos(about), np.sin(about), 0.0]))
    pad = replace(tilted.pad, rest_position_m=built.pad.rest_position_m + off_m)
    return replace(tilted, pad=pad, magnet_off_m=built.magnet_off_m + off_m[:2])


@dataclass(frozen=True, slots=True)
class PadNow:
    """The built pad with its magnet at this temperature, and the warming of the chips above 25 °C."""

    built: MountedPad
    magnet: Magnet
    warming_k: float


class Imperfections:
    """The state of one simulated pad's imperfections. Frames must come in the order of time."""

    def __init__(
        self,
        kinds: Collection[str],
        shape: FingerShape,
        built: MountedPad,
        rate_hz: float,
        random: np.random.Generator,
    ) -> None:
        count = len(built.pad.sensors)
        self._shape = shape
        self.silicone = Silicone(count) if "silicone" in kinds else None
        self._soft_iron = np.eye(3) + random.normal(0.0, SOFT_IRON, (3, 3)) * ("soft_iron" in kinds)
        self._chips = ImperfectChips(kinds, count, built.pad.chip, rate_hz, random)

    def drift_times(self, factor: float) -> None:
        """Let the chips' offsets drift so many times as much."""
        self._chips.offset_t_per_k *= factor

    def field(self, now: PadNow, touches: Sequence[Touch], ambient_t: Array, time_s: Array) -> Array:
        """(K, N, 3) the chips' readings without noise, at each sensor's times (K, N) in an ambient field
        (K, N, 3). touches: of these times, one after the other; empty where the pad is not mounted."""
        built, places_m = now.built, now.built.pad.sensors.position_m
        field_t = ambient_t @ self._soft_iron.T
        if touches:
            position_m, axis = self.pose(built, touches, time_s)
            field_t = field_t + cylinder_field(places_m, position_m, axis, now.magnet)
            if self._shape.steel:
                touched = np.array([touch.force_n > 0.0 for touch in touches]).reshape(*time_s.shape, 1)
                # The top sinks about as far as the magnet: the gap between magnet and steel stays.
                field_t = field_t + touched * thimble_field(places_m, position_m, axis, TOP_M, now.magnet)
        return self._chips.reported(time_s, built.sensed(field_t), now.warming_k)

    def pose(self, built: MountedPad, touches: Sequence[Touch], time_s: Array) -> tuple[Array, Array]:
        """Position (K, N, 3) and axis (K, N, 3) of the magnet at each sensor's times (K, N)."""
        press = built.centred(*columns(touches))
        response = self._shape.response(built.mechanics, press).reshape(*time_s.shape, 5)
        if self.silicone is not None:
            response = self.silicone.moved(time_s, response)
        position_m, axis = built.moved(response.reshape(-1, 5))
        return position_m.reshape(*time_s.shape, 3), axis.reshape(*time_s.shape, 3)

    def transferred(self, counts: NDArray[np.int16]) -> NDArray[np.int16]:
        """The counts (…, N, 3) after the bus."""
        return self._chips.transferred(counts)
