"""Six MLX90393 on each of four boards, waved in the Earth's field: github.com/nchang430/magnetic_skin, folder data/.

They turn by some 20° from one reading to the next.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product
from pathlib import Path

import numpy as np

from fmfts.baseline.sensitivity import Sensitivity, matrices
from fmfts.baseline.turn import Turn, sensitivity_from_turn
from fmfts.baseline.window_means import turning_means
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Pad, SensorArray, Tolerance
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS

BOARDS = ("PlainFoam", "PlainEcoflex", "MagFoam", "MagEcoflex")
SENSORS = 6
# The files contain no times. Any value will do: all chips of a row count as read at once.
ROW_US = 20_000
CHIP, GAIN_CODE = CHIPS["mlx90393"], 0
# MLX90393 data sheet: sensitivities differ by some percent. Soldered by hand: three degrees.
TOLERANCE = Tolerance(2e-4, 2e-4, 0.02, gain=0.05, remanence=0.1, sensor_rotation_rad=np.radians(3.0), cross_axis=0.02)
RIGHT_ANGLES = [
    matrix
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(matrix := np.eye(3)[list(order)] * np.array(signs)[:, None]) > 0.0
]


def file_of(board: str) -> str:
    """Its name in the folder of recordings."""
    return f"magnetic_skin/{board} 5X1 Board Calibration.npz"


def _waved(recorded: Path) -> Array:
    """(K, 6, 3) tesla. A row of the file: x, y, z in µT and a temperature for each chip, and one number more."""
    with np.load(recorded) as file:
        rows = file["data"][:, : 4 * SENSORS]
    fields: Array = rows.reshape(-1, SENSORS, 4)[:, :, :3] * 1e-6
    return fields


def _drawn(fields: Array) -> Pad:
    """The right angles between each chip and the last one, as in a drawing of the board."""
    swept = fields - fields.mean(axis=0)
    axes = [
        max(RIGHT_ANGLES, key=lambda turn: np.sum(turn @ swept[:, sensor].T * swept[:, -1].T)) for sensor in range(6)
    ]
    standard = PadConfig(name="standard", source=SimulatedSource()).pad()
    return replace(standard, sensors=SensorArray(np.zeros((SENSORS, 3)), np.array(axes)))


def _turn(fields: Array) -> Turn:
    """The turn as the daemon would have recorded it."""
    counts = np.rint(fields / CHIP.step_t[GAIN_CODE]).astype(np.int16)
    ages, yes = np.zeros(SENSORS, np.uint16), np.ones(SENSORS, bool)
    frames = [
        Frame(0, row, row * ROW_US, row * ROW_US * 1000, GAIN_CODE, one, ages, yes, yes, None, chip=CHIP)
        for row, one in enumerate(counts, 1)
    ]
    return Turn.of(turning_means(frames))


def turned(recorded: Path) -> tuple[Pad, Turn, Sensitivity]:
    """The result of `baseline --turn` on the recording of a board, whose drawing has its chips' right angles."""
    fields = _waved(recorded)
    pad, turn = _drawn(fields), _turn(fields)
    return pad, turn, sensitivity_from_turn(pad, Sensitivity.untested(SENSORS, TOLERANCE), turn)


def chi_square_per_value(pad: Pad, turn: Turn, found: Sensitivity) -> float:
    """What is left of the chips' readings after one field for each attitude, by the noise of frames."""
    by_field = matrices(found.mean) @ pad.sensors.axes.transpose(0, 2, 1)
    whitened = (turn.field_t - turn.field_t.mean(axis=0)) / turn.deviation_t
    basis, _, _ = np.linalg.svd((by_field / turn.deviation_t[..., None]).reshape(-1, 3), full_matrices=False)
    rows = whitened.reshape(len(whitened), -1)
    left = rows - rows @ basis @ basis.T
    # Offsets and sensitivities are 12 numbers a sensor.
    return float(np.sum(left**2) / (left.size - 3 * len(left) - 12 * SENSORS))


def apart(one: Sensitivity, other: Sensitivity) -> tuple[float, float]:
    """By how much two turns of the same chips differ: gains, and rotations (degrees). A factor and a rotation that all
    chips share stay unknown."""
    difference = matrices(one.mean) - matrices(other.mean)
    gains, turned = np.einsum("iaa->ia", difference), (difference - difference.transpose(0, 2, 1)) / 2.0
    rotations_rad = np.sqrt(np.mean((turned - turned.mean(axis=0)) ** 2) * 1.5)
    return float(np.std(gains)), float(np.degrees(rotations_rad))
