"""Where to press next: the press that lowers the worst deviation of a sensor's place most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts_calibrate.learn.drawing import REST
from fmfts_calibrate.learn.fit import Fields, projected
from fmfts_calibrate.learn.search import Learned, information_of
from fmfts_calibrate.learn.uniqueness import relative_place_deviation_m

Array = NDArray[np.float64]
TIMES = 10  # presses of one place: enough to show a difference


@dataclass(frozen=True, slots=True)
class NextPress:
    """number of the candidate; the worst deviation (m) of a sensor's place now, and after TIMES such presses."""

    number: int
    now_m: float
    then_m: float


def next_press(learned: Learned, fields: Fields, steps: Array) -> NextPress:
    """steps (C, 5): how each press that may come moves the magnet from rest, in m and rad."""
    fit = replace(learned.fit, information=information_of(learned.fit, learned.inflation))
    geometry = learned.drawing.geometry(fit.vector)
    worst = []
    for step in steps:
        state = geometry.rest.stepped(step)
        _, own, shared = learned.drawing.derivatives(geometry, state)
        weight = np.where(np.isfinite(fields.rest_t).ravel(), 1.0 / fields.deviation_t.ravel(), 0.0)
        shared[:, REST] = 0.0
        told = projected(weight[:, None] * own, weight[:, None] * shared) / learned.inflation * np.sqrt(TIMES)
        more = replace(fit, information=fit.information + told.T @ told)
        worst.append(float(relative_place_deviation_m(learned.drawing, more).max()))
    best = int(np.argmin(worst))
    return NextPress(best, float(relative_place_deviation_m(learned.drawing, fit).max()), worst[best])
