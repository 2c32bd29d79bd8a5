"""Make `simulate/mechanics.csv`: the magnet poses behind a calibration set, recovered with the exact cylinder.

python -m fmfts.calibrate.mechanics tests/data/calibration_1.23T.csv
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from fmfts.calibrate.dataset import read_calibration_set
from fmfts.pad import Array, Pad
from fmfts.simulate.cylinder import cylinder_field
from fmfts.simulate.mechanics import TABLE_PATH

STEP = np.array([1e-7, 1e-7, 1e-7, 1e-5, 1e-5])  # m and rad: central differences of the field, exact to 1e-9


def recover_poses(field_t: Array, pad: Pad) -> Array:
    """Poses (K, 5) — displacement from rest in m, axis x and y — whose exact field is `field_t` (K, n, 3).

    Gauss–Newton from rest, remanence held at the pad's. ValueError if a field is not explained to 2 nT.
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


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    calibration = read_calibration_set(Path(arguments[0]))
    response = recover_poses(calibration.field_t, calibration.pad)
    columns = [
        calibration.x_m * 1e3,
        calibration.y_m * 1e3,
        calibration.force_n,
        response[:, :3] * 1e6,
        response[:, 3:],
    ]
    np.savetxt(
        TABLE_PATH,
        np.round(np.column_stack(columns), 7) + 0.0,
        fmt=["%g", "%g", "%g", "%.4f", "%.4f", "%.4f", "%.7f", "%.7f"],
        delimiter=",",
        header="x_mm,y_mm,force_n,dx_um,dy_um,dz_um,axis_x,axis_y",
        comments="",
    )
    print(f"{TABLE_PATH}: {len(response)} poses")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
