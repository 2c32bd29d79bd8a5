"""The errors that both a frame's covariance and the baseline's leftovers contain.

What the baseline leaves unknown of the chips is in the deviation of each measurement, so that the solver trusts those
least that it knows least. So it is in the frame's covariance C, as if it were new in each measurement. The error of a
change of pose (`Leftover.change_error`) is that of the same causes, and knows how they act together. Only one may
count. With H the slopes of the measurements, W their weights, and L² the lasting part of their variances, a frame's
estimate moves by C·Hᵀ·W per measurement, so the part of C to take away is

    C·Hᵀ·W·L²·W·H·C

With N² the other part of the variances and Ω the prior's information, C·(HᵀWH + Ω)·C = C and W = (N² + L²)⁻¹. So what
is left of C is C·(HᵀW·N²·WH + Ω)·C: it never has a negative variance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.pad import Pad
from fmfts.pose.model import predict
from fmfts.pose.problem import Part, Parts, magnet_rows, measurement_rows
from fmfts.pose.state import AMBIENT, LOG_MOMENT, State

Array = NDArray[np.float64]

POSE = slice(0, 5)
# A smaller share of every measurement's variance is not taken away: deviations would change by half a thousandth.
NEGLIGIBLE = 1e-3


def overlap(pad: Pad, state: State, covariance: Array, parts: Parts, deviation_t: Array, lasting_t: Array) -> Array:
    """(5, 5) the part of a pose's covariance that `lasting_t` (N, 3) has brought into it.

    pad: as mounted. state, covariance (SIZE, SIZE): the solution of a frame that has used all measurements. deviation_t
    (N, 3): of the measurements, lasting part included.
    """
    if (square(lasting_t) <= NEGLIGIBLE * square(deviation_t)).all():
        return np.zeros((5, 5))
    estimated = np.flatnonzero(np.isin(parts[: AMBIENT.stop], (Part.FREE, Part.PRIOR)))
    own = covariance[POSE][:, estimated]
    if parts[LOG_MOMENT] == Part.CONSIDERED and covariance[LOG_MOMENT, LOG_MOMENT] > 0.0:
        # What a considered moment adds is no error of a measurement.
        by_moment = covariance[:, LOG_MOMENT]
        own = own - np.outer(by_moment[POSE], by_moment[estimated]) / covariance[LOG_MOMENT, LOG_MOMENT]
    rows = measurement_rows(np.zeros(deviation_t.shape), pad.sensors, 1.0)
    _, slopes = predict(rows, magnet_rows(pad.magnet), state)
    moved = product(own, slopes[:, estimated].T)
    weight = (square(lasting_t) / square(square(deviation_t))).ravel()
    return np.asarray(product(moved * weight, moved.T), dtype=np.float64)
