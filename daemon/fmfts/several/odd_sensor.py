"""Finds the one sensor without which fingers explain a frame that they do not explain with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError
from fmfts.common.chi2 import quantile
from fmfts.several.count import CounterMemory, FingerCounter
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Fit, Fitter, Measured

Array = NDArray[np.float64]

FREE_FIELD = 3  # values that the ambient field takes
# So many values more than the unknowns of two fingers are needed to notice that something is wrong.
SPARE = 4
FEWEST_VALUES = FREE_FIELD + 2 * FINGER + SPARE
# A frame is not explained when its χ² is larger than one in so many healthy ones has it.
UNEXPLAINED = 1e-6


class Odd(NamedTuple):
    """sensor: the odd one. chi2: of the frame without it. memory: of the counter, that goes on without it."""

    sensor: int
    chi2: float
    memory: CounterMemory


def limit(probability: float, used: NDArray[np.bool_], fit: Fit) -> float:
    """The χ² that a healthy frame exceeds with this probability. used (N, 3): the values that it was made from."""
    freedom = int(np.count_nonzero(used)) - FREE_FIELD - FINGER * len(fit.fingers)
    return quantile(probability, max(freedom, 1))


def odd_sensor(
    fitter: Fitter,
    measured: Measured,
    there: NDArray[np.bool_],
    ambient_t: Array,
    memories: tuple[CounterMemory, ...],
    searched: int,
    cold: FingerCounter,
) -> Odd | None:
    """The sensor whose absence leaves the least χ²; None where no absence is enough.

    there (N, 3): the values that there are. memories: of counters whose fingers may be the right ones. searched: a
    sensor without which `cold`, a counter without memory, searches fingers anew; one a frame, for that takes long.
    """
    found: list[Odd] = []
    for sensor in np.flatnonzero(there.any(axis=1)).tolist():
        used = there.copy()
        used[sensor] = False
        if used.sum() < FEWEST_VALUES:
            continue
        without = measured.only(used)
        try:
            for memory in memories:
                fit = fitter.fit(memory.fingers, without, ambient_t)
                if fit.chi2 <= limit(UNEXPLAINED, used, fit):
                    found.append(Odd(sensor, fit.chi2, memory))
            if sensor == searched:
                cold.forget()
                fit = cold.update(without, ambient_t).fit
                if fit.chi2 <= limit(UNEXPLAINED, used, fit):
                    found.append(Odd(sensor, fit.chi2, cold.memory.copy()))
        except SingularError:
            continue  # without this sensor the others do not tell
    return min(found, key=lambda one: one.chi2, default=None)
