"""`--turn` on boards that somebody waved in the Earth's field: github.com/nchang430/magnetic_skin, the folder data/.

Six MLX90393 on each of four boards, some 20° from one reading to the next. The repository has no licence: its files are
not here; FMFTS_RECORDED names a folder with a folder magnetic_skin that has them.
"""

from __future__ import annotations

import pytest
from recorded_files import needs

from fmfts.baseline.sensitivity import Sensitivity, relative_deviation
from fmfts.baseline.turn import Turn
from fmfts.pad import Pad
from fmfts_lab.real.waved_boards import BOARDS, apart, chi_square_per_value, file_of, turned


def _found(board: str) -> tuple[Pad, Turn, Sensitivity]:
    return turned(needs(file_of(board)))


@pytest.mark.parametrize("board", BOARDS)
def test_real_board_that_was_waved_is_accepted(board: str) -> None:
    pad, turn, found = _found(board)
    assert 0.8 < chi_square_per_value(pad, turn, found) < 1.3
    assert relative_deviation(found.covariance).max() < 0.02


def test_one_board_under_two_elastomers_has_the_same_chips() -> None:
    gains, rotations_deg = apart(*(_found(board)[2] for board in BOARDS[:2]))
    assert gains < 0.014
    assert rotations_deg < 0.6
