"""`--turn` on boards that somebody waved in the Earth's field: github.com/nchang430/magnetic_skin, the folder data/.

Six MLX90393 on each of four boards, some 20° from one reading to the next. The repository has no licence: its files are
not here; FMFTS_RECORDED names a folder with a folder magnetic_skin that has them.
"""

from __future__ import annotations

import numpy as np
import pytest
from recorded_files import needs

from fmfts.baseline.sensitivity import Sensitivity, matrices, relative_deviation
from fmfts.baseline.turn import Turn
from fmfts.pad import Pad
from fmfts_lab.real.waved_boards import BOARDS, SENSORS, file_of, turned


def _found(board: str) -> tuple[Pad, Turn, Sensitivity]:
    return turned(needs(file_of(board)))


@pytest.mark.parametrize("board", BOARDS)
def test_real_board_that_was_waved_is_accepted(board: str) -> None:
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
    # A factor and a rotation shared by all chips stay unknown.
    assert np.std(gains) < 0.014
    assert np.degrees(np.sqrt(np.mean((turned - turned.mean(axis=0)) ** 2) * 1.5)) < 0.6
