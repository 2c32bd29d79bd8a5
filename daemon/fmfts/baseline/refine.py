"""Estimates sensor places, gains and magnet from unlabelled presses, and chooses the presses to use."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import lengths, root_of_squares
from fmfts.baseline.learned import LearnedGeometry
from fmfts.baseline.leftover import TYPICAL_CHANGE
from fmfts.baseline.mounting import Mounting, estimate_mounting
from fmfts.baseline.presses import Presses
from fmfts.baseline.recording import BaselineError, Recording
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.window_means import MEAN_OF, Means
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad, Tolerance
from fmfts.pose import FREE_POSE, Status, change_since, solve

Array = NDArray[np.float64]

FEWEST, MOST = 15, 40
# If the field moves by less during a mean (20 mG: the magnet moves 0.1 mm), its curvature changes the mean by < 0.1 mG.
STEADY_T = 2e-6
# Poses nearer than this to rest or to each other, in typical presses, are redundant.
SMALLEST_DISTANCE = 0.1
FALSE_OUTLIER = 1e-4
LARGEST_MISFIT = 5.0
MOST_OUTLIERS = 0.2


@dataclass(frozen=True, slots=True)
class PressFields:
    """field_t (K, N, 3) in sensor axes, the deviation (N, 3) of each, and rest_t (N, 3) of the untouched pad."""

    field_t: Array
    deviation_t: Array
    rest_t: Array


@dataclass(frozen=True, slots=True)
class AtRest:
    """Everything from which a mounting at rest is estimated."""

    pad: Pad
    tolerance: Tolerance
    rest: Recording
    bare: Recording | None
    measured: Sensitivity
    learned: LearnedGeometry | None = None


def refined(known: AtRest, mounting: Mounting, fields: PressFields) -> Mounting:
    """Improves `mounting`, the estimate at rest, with the presses."""
    change = fields.field_t - fields.rest_t
    deviation = root_of_squares(fields.deviation_t, known.rest.mean_deviation_t)
    if known.learned is not None:
        presses = Presses(change, deviation, known.learned.states(mounting.rest), known.learned.place_m)
    else:
        mounted = mounting.mounted(known.pad)
        start = tuple(
            solve(mounting.magnet_field(known.rest.mean_t + one), mounted, mounting.rest, free=FREE_POSE).state
            for one in change
        )
        presses = Presses(change, deviation, start)
    return estimate_mounting(
        known.pad, known.tolerance, known.rest, known.bare, measured=known.measured, presses=presses
    )


def pick(known: AtRest, mounting: Mounting, means: Means) -> PressFields:
    """Choose the presses to keep. BaselineError if there are too few, or if something other than a finger moved.

    If they scatter by more than their noise, their deviation is set to the scatter.
    """
    field = _spread_out(known.pad, mounting, means)
    fields = PressFields(field, means.noise_t / np.sqrt(MEAN_OF), known.rest.mean_t)
    chi2 = refined(known, mounting, fields).press_chi2
    freedom = known.rest.mean_t.size - 5
    inflation = max(1.0, float(np.sqrt(np.median(chi2) / freedom)))
    fits = chi2 < quantile(FALSE_OUTLIER, freedom) * square(inflation)
    if inflation > LARGEST_MISFIT or np.mean(~fits) > MOST_OUTLIERS:
        raise BaselineError(
            f"the presses do not fit one magnet above these sensors: {(~fits).sum()} of {len(fits)} are off, "
            f"the median by {inflation:.1f} times its noise: "
            "hold the robot still, keep steel away, and press with a finger"
        )
    if fits.sum() < FEWEST:
        raise BaselineError(_too_few(int(fits.sum())))
    return replace(fields, field_t=field[fits], deviation_t=fields.deviation_t * inflation)


def _spread_out(pad: Pad, mounting: Mounting, means: Means) -> Array:
    """(K, N, 3) fields of steady presses, chosen as far from each other and from rest as possible."""
    mounted = mounting.mounted(pad)
    fields, changes = [], []
    noise = float(means.noise_t.max()) * np.sqrt(2.0 / (MEAN_OF // 2))
    for field in means.field_t[means.wander_t < STEADY_T + 4.0 * noise]:
        estimate = solve(mounting.magnet_field(field), mounted, mounting.rest, free=FREE_POSE)
        if estimate.status is Status.CONVERGED:
            fields.append(field)
            changes.append(change_since(mounting.rest, estimate.state)[:5] / TYPICAL_CHANGE)
    if not fields:
        raise BaselineError(_too_few(0))
    change = np.array(changes)
    distance = lengths(change)
    chosen: list[int] = []
    while len(chosen) < MOST and distance.max() > SMALLEST_DISTANCE:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, lengths(change - change[chosen[-1]]))
    if len(chosen) < FEWEST:
        raise BaselineError(_too_few(len(chosen)))
    return np.array(fields)[chosen]


def _too_few(count: int) -> str:
    return (
        f"only {count} different presses were found, of at least {FEWEST}: press some 30 times, each for a moment, all "
        "over the pad and from lightly to firmly"
    )
