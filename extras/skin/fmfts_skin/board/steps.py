"""How many microtesla is one count of the board's chips? The stream does not say; its values tell.

The firmware multiplies each count by a step that follows from the chips' gain and resolution. A board's builder may
change both, so the coarsest published step that divides all values is taken. Counts of
that step are the chips' own: nothing is rounded. A value between two steps was damaged on its way.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from fmfts.sensor.chips.mlx90393 import ANYSKIN, STREAMED_LARGEST, STREAMED_UNKNOWN

Array = NDArray[np.float64]

RECENT = 200  # packets
OFF_SHARE = 0.02  # share of the values that a step may leave unexplained: damaged packets
DOUBT = 20  # this many packets off the step among the recent ones: the step is another one
# How far a value may be from a multiple: half of the text's second decimal, and a few roundings of 32-bit floats.
# Recordings that people publish have six digits; they can be streamed as well.
TOLERANCE_UT, TOLERANCE = 0.0051, 6e-6

_STEPS_UT = ANYSKIN.step_t[: len(ANYSKIN.counts_per_gauss)] * 1e6
_COARSEST_FIRST = np.argsort(-_STEPS_UT[:, 0]).tolist()


class Steps:
    """code: the streamed chip's gain code, which gives the size of a count; −1 until it is learnt.

    is_known: the board's values are multiples of that size.
    """

    def __init__(self) -> None:
        self.code, self.is_known = -1, False
        self._recent: deque[Array] = deque(maxlen=RECENT)
        self._off: deque[bool] = deque(maxlen=RECENT)

    def hear(self, fields_ut: Array) -> None:
        """A packet (N, 3) that is not counted; NaN: no measurement."""
        self._recent.append(fields_ut)

    def counts(self, fields_ut: Array) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        """The packet's counts (N, 3), and which of its N magnetometers have values of the board's step."""
        self._recent.append(fields_ut)
        if self.code < 0 or sum(self._off) >= DOUBT:
            self._learn()
        valid = np.ones(len(fields_ut), dtype=np.bool_)
        if self.is_known:
            valid &= _are_multiples(fields_ut, self.code).all(axis=1)
        self._off.append(not valid.all())
        counted = np.round(fields_ut / _STEPS_UT[self.code])
        in_range = np.abs(counted) <= STREAMED_LARGEST[self.code]
        return np.where(in_range, counted, ANYSKIN.saturated_count).astype(np.int16), valid

    def _learn(self) -> None:
        """The coarsest step that explains all but a few of the recent values."""
        recent = np.array(self._recent)
        fits = (code for code in _COARSEST_FIRST if _are_multiples(recent, code).mean() >= 1.0 - OFF_SHARE)
        code = next(fits, None)
        self.code, self.is_known = STREAMED_UNKNOWN if code is None else code, code is not None
        self._off.clear()


def _are_multiples(fields_ut: Array, code: int) -> NDArray[np.bool_]:
    """True for each value that is a multiple of the step, and for NaN: a value that is missing is not wrong."""
    step = _STEPS_UT[code]
    away = np.abs(fields_ut - np.round(fields_ut / step) * step)
    near: NDArray[np.bool_] = ~(away > TOLERANCE_UT + TOLERANCE * np.abs(fields_ut))
    return near
