"""Recovers the magnet's poses from a calibration set with the exact field of a cylinder, to compare pads' mechanics."""

from __future__ import annotations

import numpy as np

from fmfts.pad import Array, Pad
from fmfts_simulation.cylinder import cylinder_field

STEP = np.array([1e-7, 1e-7, 1e-7, 1e-5, 1e-5])  # m and rad: central differences of the field, exact to 1e-9


def recover_poses(field_t: Array, pad: Pad) -> Array:
    """Poses (K, 5) — displacement from rest in m, axis x and y — whose exact field is `field_t` (K, n, 3).

    Gauss–Newton from rest, with the pad's remanence. Raises ValueError if a field is not explained to 2 nT.
    """

    def model(pose: Array) -> Array:
        tilt = pose[:, 3:]
        upright = np.sqrt(1.0 - np.sum(tilt**2, axis=1, keepdims=True))
        axis = np.concatenate([tilt, upright], axis=1)
        position = pad.rest_position_m + pose[:, :3]
        return cylinder_field(pad.sensors.position_m, position[:, None], axis[:, None], pad.magnet).reshape(
            len(pose), -1
        )

    pose = np.zeros((len(field_t), 5))
    measured = field_t.reshape(len(field_t), -1)
    for _ in range(8):
        jacobian = np.stack([(model(pose + step) - model(pose - step)) / 2.0 for step in np.diag(STEP)], axis=-1)
        normal = np.einsum("kij,kil->kjl", jacobian, jacobian)
        gradient = np.einsum("kij,ki->kj", jacobian, measured - model(pose))
        pose += np.linalg.solve(normal, gradient[..., None])[..., 0] * STEP
    worst = float(np.max(np.abs(measured - model(pose))))
    if worst > 2e-9:
        raise ValueError(f"a pose leaves {worst * 1e6:.4f} µT unexplained: is this the field of pad {pad.name!r}?")
    return pose
