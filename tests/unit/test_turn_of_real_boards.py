"""`--turn` on boards that somebody waved in the Earth's field: github.com/nchang430/magnetic_skin, the folder data/.

Six MLX90393 on each of four boards, some 20° from one reading to the next. The repository has no licence: its files are
not here; FMFTS_RECORDED names a folder with a folder magnetic_skin that has them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from recorded_files import needs

from fmfts.baseline.sensitivity import Sensitivity, matrices, relative_deviation
from fmfts.baseline.turn import Turn, sensitivity_from_turn
from fmfts.baseline.window_means import turning_means
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad, SensorArray, Tolerance
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS

BOARDS = ("PlainFoam", "PlainEcoflex", "MagFoam", "MagEcoflex")
SENSORS = 6
# The files tell no times. Any will do: all chips of a row count as read at once.
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


def _waved(board: str) -> np.ndarray:
    """(K, 6, 3) tesla. A row of the file: x, y, z in µT and a temperature for each chip, and one number more."""
    with np.load(needs(f"magnetic_skin/{board} 5X1 Board Calibration.npz")) as file:
        rows = file["data"][:, : 4 * SENSORS]
    fields: np.ndarray = rows.reshape(-1, SENSORS, 4)[:, :, :3] * 1e-6
    return fields


def _drawn(fields: np.ndarray) -> Pad:
    """By which right angles the chips are turned against the last one, as a drawing of the board would say."""
    swept = fields - fields.mean(axis=0)
    axes = [
        max(RIGHT_ANGLES, key=lambda turn: np.sum(turn @ swept[:, sensor].T * swept[:, -1].T)) for sensor in range(6)
    ]
    standard = PadConfig(name="standard", source=SimulatedSource()).pad()
    return replace(standard, sensors=SensorArray(np.zeros((SENSORS, 3)), np.array(axes)))


def _turn(fields: np.ndarray) -> Turn:
    """As the daemon would have recorded it."""
    counts = np.rint(fields / CHIP.step_t[GAIN_CODE]).astype(np.int16)
    ages, yes = np.zeros(SENSORS, np.uint16), np.ones(SENSORS, bool)
    frames = [
        Frame(0, row, row * ROW_US, row * ROW_US * 1000, GAIN_CODE, one, ages, yes, yes, None, chip=CHIP)
        for row, one in enumerate(counts, 1)
    ]
    return Turn.of(turning_means(frames))


def _found(board: str) -> tuple[Pad, Turn, Sensitivity]:
    fields = _waved(board)
    pad, turn = _drawn(fields), _turn(fields)
    return pad, turn, sensitivity_from_turn(pad, Sensitivity.untested(SENSORS, TOLERANCE), turn)


@pytest.mark.parametrize("board", BOARDS)
def test_a_real_board_that_was_waved_is_accepted(board: str) -> None:
    """χ² per value: what is left of the six chips' readings after one field each time, by the noise of frames."""
    pad, turn, found = _found(board)
    by_field = matrices(found.mean) @ pad.sensors.axes.transpose(0, 2, 1)
    whitened = (turn.field_t - turn.field_t.mean(axis=0)) / turn.deviation_t
    basis, _, _ = np.linalg.svd((by_field / turn.deviation_t[..., None]).reshape(-1, 3), full_matrices=False)
    rows = whitened.reshape(len(whitened), -1)
    left = rows - rows @ basis @ basis.T
    # Offsets and sensitivities are 12 numbers a sensor.
    assert 0.8 < np.sum(left**2) / (left.size - 3 * len(left) - 12 * SENSORS) < 1.3
    assert relative_deviation(found.covariance).max() < 0.02


def test_one_board_under_two_elastomers_has_the_same_chips() -> None:
    foam, ecoflex = (matrices(_found(board)[2].mean) for board in BOARDS[:2])
    apart = foam - ecoflex
    gains, turned = np.einsum("iaa->ia", apart), (apart - apart.transpose(0, 2, 1)) / 2.0
    # A factor and a rotation that all chips have in common stay unknown.
    assert np.std(gains) < 0.014
    assert np.degrees(np.sqrt(np.mean((turned - turned.mean(axis=0)) ** 2) * 1.5)) < 0.6
