"""A frame that the fingers of the last one explain, as most are: C reads all of it in one call (ordinary.c)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.pose import Aligned
from fmfts.several import _several
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Fit, Fitter
from fmfts.several.measured import Measured
from fmfts.several.poses import UNFELT, Poses
from fmfts.several.since_rest import SinceRest
from fmfts.several.valley import LIMITS

Array = NDArray[np.float64]


@dataclass(slots=True)
class Ordinary:
    """fit: of the fingers of before; None where values are missing, or tell too little. is_ordinary: no closer look is
    needed. poses: of an ordinary frame with fingers. least: see FingersReading."""

    measured: Measured
    has_jumped: bool
    fit: Fit | None
    is_ordinary: bool
    poses: Poses
    least: Array | None


class OrdinaryReader:
    """most_chi2: of an ordinary frame with so many fingers."""

    def __init__(self, fitter: Fitter, since_rest: SinceRest, most_chi2: Array) -> None:
        self._fitter, self._since_rest = fitter, since_rest
        self._limits = np.array([*most_chi2, *LIMITS, *UNFELT])
        self._unmoved = Poses.room(fitter.model.mounting.magnets)

    def read(self, aligned: Aligned, fingers: Array, recent_t: Array) -> Ordinary:
        """fingers (K, 3): of the frame before. recent_t (3N,): of Recovery, which is written."""
        since, model, values = self._since_rest, self._fitter.model, aligned.field_t.size
        measured, fit = Measured.room(values), Fit.room(len(fingers), values)
        poses = Poses.room(model.mounting.magnets) if len(fingers) else self._unmoved
        least = np.empty((1 + len(fingers), FINGER))
        samples = aligned.field_t, aligned.bend_t, aligned.noise_share, aligned.repeats
        change = recent_t, measured.field_t, measured.variance_t2, measured.used
        given = self._limits, since.rest, since.factors, *samples, fingers, since.around_t
        fit.chi2, fit.flags, ways, has_jumped, has_fit, is_ordinary = _several.ordinary(
            *model.parts, self._fitter.search, *given, *change, *fit.arrays, *poses.arrays, least
        )
        return Ordinary(measured, has_jumped, fit if has_fit else None, is_ordinary, poses, least if ways else None)
