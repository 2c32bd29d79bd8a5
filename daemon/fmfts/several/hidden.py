"""A hidden second finger: it explains the frame better, but not enough to report two.

Beside the one reported finger, each place of the grid has a second finger that lowers χ² most, by a gain g. With it
the resultant would be elsewhere, by d: the first finger gives force to the second. Frames of one finger rarely have a
large gain (lab/results/several.md); frames of two that are reported as one mostly have. So d counts as an error of a
share of these frames, which rises to `MOST` as g passes `HALF_GAIN`:

    variance = σ² + max over places of d² · MOST / (1 + e^((HALF_GAIN − g) / WIDTH))
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp
from fmfts.several.scan import Another

Array = NDArray[np.float64]

# 4 % of the one-finger frames on built pads exceed this gain, and 90 % of the frames that wrongly report two as one.
HALF_GAIN, WIDTH = 10.0, 0.5
# An error of d is then less than five deviations.
MOST = 1.0 / 16.0
LEAST_GAIN = HALF_GAIN - 6.0 * WIDTH  # below it the share is 1e-4


def hidden_variance(finger: Array, another: Another) -> Array:
    """(3,) variances of the resultant's place (mm²) and force (N²), from a hidden finger beside `finger` (3,)."""
    likely = np.flatnonzero(another.gain > LEAST_GAIN)
    most = np.zeros(3)
    for number in likely.tolist():
        second = float(another.force[number])
        left = finger - another.by_force[:, number] * second
        first = max(float(left[2]), 0.0)
        whole = first + second
        place = (left[:2] * first + another.places[number, :2] * second) / whole
        off = np.append(place, whole) - finger
        share = MOST / (1.0 + exp((HALF_GAIN - float(another.gain[number])) / WIDTH))
        most = np.maximum(most, share * off * off)
    return most
