"""Finds the one sensor without which fingers explain a frame that they do not explain with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError
from fmfts.common.chi2 import quantile
from fmfts.pose.observable import FREE_FIELD
from fmfts.several.count import CounterMemory, FingerCounter
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Fitter, Measured
from fmfts.several.recovery import RestMemory

Array = NDArray[np.float64]

# Number of redundant values, beyond the unknowns of two fingers, that detecting a fault needs.
SPARE = 4
FEWEST_VALUES = FREE_FIELD + 2 * FINGER + SPARE
# A frame is unexplained if only this share of healthy frames has a larger χ².
UNEXPLAINED = 1e-6
# An excluded sensor agrees if its values fit as well as in all but a thousandth of healthy frames. After this many such
# frames in a row it is used again.
AGREES, AGREES_FRAMES = 1e-3, 20


class Odd(NamedTuple):
    """sensor: the odd one. chi2: of the frame without it. memory: of the counter, that goes on without it."""

    sensor: int
    chi2: float
    memory: CounterMemory


def note_agreement(memory: RestMemory, there: NDArray[np.bool_], rise: float) -> None:
    """Use a sensor that was left out again, when it has agreed for long enough. there (N, 3): the values that there
    are. rise: of χ² with it."""
    values = int(there[memory.left_out].sum())
    agrees = values > 0 and rise < quantile(AGREES, values)
    memory.agrees_frames = memory.agrees_frames + 1 if agrees else 0
    if memory.agrees_frames >= AGREES_FRAMES:
        memory.left_out, memory.agrees_frames = -1, 0


def odd_sensor(
    fitter: Fitter,
    measured: Measured,
    there: NDArray[np.bool_],
    ambient_t: Array,
    before: CounterMemory,
) -> Odd | None:
    """The sensor whose absence leaves the least χ²; None where no absence is enough.

    there (N, 3): the values that there are. before: a counter's memory, whose fingers may be right.
    """
    found: list[Odd] = []
    for sensor in np.flatnonzero(there.any(axis=1)).tolist():
        used = there.copy()
        used[sensor] = False
        if used.sum() < FEWEST_VALUES:
            continue
        without = measured.only(used)
        try:
            fit = fitter.fit(before.fingers, without, ambient_t, few_iterations=True)
        except SingularError:
            continue  # without this sensor the others do not determine the fingers
        if fit.chi2 <= fit.limit(UNEXPLAINED):
            found.append(Odd(sensor, fit.chi2, before))
    return min(found, key=lambda one: one.chi2, default=None)


def is_odd(
    sensor: int, measured: Measured, there: NDArray[np.bool_], ambient_t: Array, cold: FingerCounter
) -> Odd | None:
    """This sensor, if `cold`, a counter without memory, finds fingers that explain the frame without it."""
    used = there.copy()
    used[sensor] = False
    if used.sum() < FEWEST_VALUES or not there[sensor].any():
        return None
    cold.forget()
    try:
        fit = cold.update(measured.only(used), ambient_t).fit
    except SingularError:
        return None
    return Odd(sensor, fit.chi2, cold.memory.copy()) if fit.chi2 <= fit.limit(UNEXPLAINED) else None
