"""The resultant of several fingers, and the deviations of each finger and of it, as they are published."""

from __future__ import annotations

import numpy as np

from fmfts.pad import Array
from fmfts.several import _several
from fmfts.several.fit import Fit
from fmfts.several.reading import FingersReading


def deviation_of(reading: FingersReading, fit: Fit) -> Array:
    """(3,) of the resultant's place and force: at least what a valley of χ² leaves of them (several/valley.py)."""
    deviation: Array = _deviations(fit, reading.least_variance)[0]
    return deviation


def deviation_of_each(reading: FingersReading, fit: Fit) -> Array:
    """(K, 3) of the place and force of each finger, as deviation_of."""
    deviation: Array = _deviations(fit, reading.least_variance)[1:]
    return deviation


def resultant_deviation(fit: Fit) -> Array:
    """(3,) of the resultant's place and force, by the fit alone."""
    deviation: Array = _deviations(fit, None)[0]
    return deviation


def _deviations(fit: Fit, least: Array | None) -> Array:
    """(1 + K, 3) of the resultant, and of each finger."""
    deviation = np.empty((1 + len(fit.fingers), 3))
    _several.resultant(fit.fingers, np.empty(3), fit.covariance, least, deviation)
    return deviation
