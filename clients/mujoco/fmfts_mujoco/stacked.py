"""Several built pads of one kind, computed together: the results of `MountedPad` for all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from fmfts.pad import Array
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.mounted import MountedPad

from fmfts_mujoco.as_built import Structures


class Stacked:
    """K pads, of equal mechanics, magnets and numbers of sensors. structures: what they are made of; None: as drawn."""

    structures: Structures | None = None

    def __init__(self, built: Sequence[MountedPad]) -> None:
        self.pads, self.sensors = len(built), len(built[0].pad.sensors)
        self.chip = built[0].pad.chip
        self.sensors_m = np.array([each.pad.sensors.position_m for each in built])
        self.remanence_t = np.array([each.pad.magnet.remanence_t for each in built])
        self._unit = built[0].pad.magnet.with_remanence(1.0)
        self._mechanics = built[0].mechanics
        self._off_m = np.array([each.magnet_off_m for each in built])
        self._rest_m = np.array([each.pad.rest_position_m for each in built])
        self._tilted = np.array([each.tilted.T for each in built])
        self._to_pad = np.array([each.rest_axis_from_z.T for each in built])
        # What a chip reports is linear in the field: its columns are its reports of the unit vectors.
        units = np.eye(3)[:, None]
        self._report = np.array(
            [each.sensed(np.broadcast_to(units, (3, self.sensors, 3))).transpose(1, 0, 2) for each in built]
        )

    def response(self, pad: np.ndarray, place_m: Array, load_n: Array) -> Array:
        """(C, 5) as `MountedPad.response`, of the pads (C,) under presses at (C, 2) with loads (C, 3)."""
        x_m, y_m = (place_m - self._off_m[pad]).T
        shear = load_n.T[1:] if np.any(load_n[:, 1:]) else ()
        press = x_m, y_m, load_n[:, 0], *shear
        if self.structures is not None:
            return self.structures.response(self._mechanics, pad, press)
        return self._mechanics.response(*press)

    def moved(self, response: Array) -> tuple[Array, Array]:
        """Position (…, K, 3) and axis (…, K, 3) of the magnets as `MountedPad.moved`, after movements (…, K, 5)."""
        tilt = response[..., 3:]
        upright = np.sqrt(1.0 - np.sum(tilt * tilt, axis=-1, keepdims=True))
        axis = np.concatenate([tilt, upright], axis=-1)
        way_m = (response[..., None, :3] @ self._tilted)[..., 0, :]
        return self._rest_m + way_m, (axis[..., None, :] @ self._to_pad)[..., 0, :]

    def magnet_field(self, response: Array) -> Array:
        """(F, K, N, 3) field of each pad's magnet at its sensors, in pad axes, under movements (F, K, N, 5)."""
        position_m, axis = (each.swapaxes(1, 2) for each in self.moved(response.swapaxes(1, 2)))
        return self.remanence_t[:, None, None] * cylinder_field(self.sensors_m, position_m, axis, self._unit)

    def field_of(self, pad: np.ndarray, place_m: Array, position_m: Array, axis: Array) -> Array:
        """Field (P, …, 3) of the magnets of pads (P,), which are at `position_m` along `axis`; all in one frame."""
        unit_t = cylinder_field(place_m, position_m, axis, self._unit)
        return np.asarray(unit_t * self.remanence_t[pad].reshape(-1, *(1,) * (unit_t.ndim - 1)))

    def sensed(self, field_t: Array) -> Array:
        """(F, K, N, 3) as `MountedPad.sensed`, of a field (F, K, N, 3) in pad axes."""
        return np.asarray((field_t[..., None, :] @ self._report)[..., 0, :])
