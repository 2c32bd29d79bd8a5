"""A frame that the fingers of the last one explain, as most are: C reads all of it in one call (ordinary.c)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.pose import Aligned
from fmfts.several import _several
from fmfts.several.count import MOST_FINGERS
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Fit, Fitter
from fmfts.several.measured import Measured
from fmfts.several.poses import UNFELT, Poses
from fmfts.several.since_rest import SinceRest
from fmfts.several.valley import LIMITS

Array = NDArray[np.float64]


@dataclass(slots=True)
class Ordinary:
    """fit: of the fingers of before. has_fit: it counts; it does not where values are missing, or tell too little.
    is_ordinary: no closer look is needed. poses: of an ordinary frame with fingers. ways: how many fingers are less
    certain than `fit` says; then `least_variance` is that of FingersReading. The next frame uses the same arrays."""

    measured: Measured
    fit: Fit
    poses: Poses
    least_variance: Array
    ways: int = 0
    has_jumped: bool = False
    has_fit: bool = False
    is_ordinary: bool = False

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All as C writes them."""
        measured = self.measured
        change = measured.field_t, measured.variance_t2, measured.used
        return *change, *self.fit.arrays, *self.poses.arrays, self.least_variance


class OrdinaryReader:
    """most_chi2: of an ordinary frame with so many fingers."""

    def __init__(self, fitter: Fitter, since_rest: SinceRest, most_chi2: Array) -> None:
        self._since_rest, rest, values = since_rest, fitter.model.mounting.magnets, since_rest.rest.shape[1]
        self._given = *fitter.model.parts, fitter.search, np.array([*most_chi2, *LIMITS, *UNFELT]), since_rest.rest
        self._found = [
            Ordinary(Measured.room(values), Fit.room(count, values), Poses.room(rest), np.empty((1 + count, FINGER)))
            for count in range(MOST_FINGERS + 1)
        ]
        self._arrays = [found.arrays for found in self._found]

    def read(self, aligned: Aligned, fingers: Array, recent_t: Array) -> Ordinary:
        """fingers (K, 3): of the frame before. recent_t (3N,): of Recovery, which is written."""
        since, found, arrays = self._since_rest, self._found[len(fingers)], self._arrays[len(fingers)]
        samples = aligned.field_t, aligned.bend_t, aligned.noise_share, aligned.repeats
        fit = found.fit
        fit.chi2, fit.flags, found.ways, found.has_jumped, found.has_fit, found.is_ordinary = _several.ordinary(
            *self._given, since.factors, *samples, fingers, since.around_t, recent_t, *arrays
        )
        return found
