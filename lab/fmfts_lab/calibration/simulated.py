"""Computes exact fields of presses on the simulated standard pad, with the mechanics of the simulated source."""

from __future__ import annotations

import numpy as np

from fmfts.pad import Array, Magnet, Pad
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.solved_table import standard_mechanics


def pressed_fields(pad: Pad, press: Array, magnet: Magnet | None = None) -> Array:
    """(K, N, 3) noise-free fields in sensor axes under presses (K, 3 or 5): x, y in mm, force and shear in N."""
    displacement_m, axis = standard_mechanics().displacement(*(press[:, :2] * 1e-3).T, *press[:, 2:].T)
    return magnet_fields(pad, displacement_m, axis, magnet)


def magnet_fields(pad: Pad, displacement_m: Array, axis: Array, magnet: Magnet | None = None) -> Array:
    """(K, N, 3) noise-free fields in sensor axes, of magnets displaced from rest by (K, 3) along axes (K, 3)."""
    position_m = pad.rest_position_m + displacement_m
    field: Array = cylinder_field(pad.sensors.position_m, position_m[:, None], axis[:, None], magnet or pad.magnet)
    return pad.sensors.to_sensor(field)


def rest_field_of(pad: Pad, magnet: Magnet | None = None) -> Array:
    """(N, 3) noise-free field of the unloaded pad, in sensor axes."""
    (field,) = pressed_fields(pad, np.zeros((1, 3)), magnet)
    return np.asarray(field, dtype=np.float64)
