"""When the damped descent of arithmetic/descent.h ends, by the steps that it tries."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from oracle.compiled import library_of

Array = NDArray[np.float64]
NUMBERS = ctypes.POINTER(ctypes.c_double)
JUDGE = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, NUMBERS)
TAKE = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
SETTLED = 0.03


class Search(ctypes.Structure):
    """fmfts_descent."""

    _fields_ = (
        *(("unknowns", ctypes.c_size_t), ("iterations", ctypes.c_size_t)),
        *((name, ctypes.c_double) for name in ("settled", "rounding", "damping", "damping_factor", "most_damping")),
        *((name, NUMBERS) for name in ("lowest", "highest", "floor")),
        *(("problem", ctypes.c_void_p), ("judge", JUDGE), ("take", TAKE), ("shorten", ctypes.c_void_p)),
    )


def tried_from_zero(folder: Path, right: Array, lowest: Array) -> list[Array]:
    """The trials, each of which raises χ², of ten at most. Both unknowns have a deviation of 1."""
    tried: list[Array] = []

    def judge(_: object, trial: ctypes._Pointer[ctypes.c_double]) -> float:
        tried.append(np.array(trial[:2]))
        return 2.0

    def take(_: object, __: object, chi2: Array, normal: Array, gradient: Array) -> bool:
        chi2[0], normal[0], normal[1], normal[2], normal[3] = 1.0, 1.0, 0.0, 0.0, 1.0
        gradient[0], gradient[1] = right
        return True

    def numbers(values: Array) -> object:
        return values.ctypes.data_as(NUMBERS)

    highest, at, chi2, room = np.full(2, 100.0), np.zeros(2), np.zeros(1), np.zeros(3 * 4 + 3 * 2)
    search = Search(
        *(2, 10, SETTLED, 1e-12, 1e-4, 10.0, np.inf, numbers(lowest), numbers(highest), None, None),
        *(JUDGE(judge), TAKE(take), None),
    )
    library = library_of(folder, "arithmetic/descent.c", "arithmetic/matrix.c")
    assert library.fmfts_descend(ctypes.byref(search), numbers(at), numbers(chi2), numbers(room)) == 0
    assert not at.any()
    return tried


@pytest.mark.parametrize("lowest", [-100.0, 0.0], ids=["free", "on its limit"])
def test_search_goes_on_while_the_step_before_limits_is_long(lowest: float, tmp_path: Path) -> None:
    """A step of 10 deviations is shorter than SETTLED from the damping 1e3 on: by 1e-4, 1e-3 … 1e3 the eighth."""
    tried = tried_from_zero(tmp_path, np.array([-10.0, 0.001]), np.array([lowest, -100.0]))
    assert len(tried) == 8
    assert all(trial[0] >= lowest for trial in tried)


def test_search_ends_at_a_short_step_that_is_rejected(tmp_path: Path) -> None:
    assert len(tried_from_zero(tmp_path, np.array([0.02, 0.001]), np.array([-100.0, -100.0]))) == 1
