"""[pad.contact] refine: moves the network's answer to the most likely press, with the table of the pad's response."""

from __future__ import annotations

import numpy as np

from fmfts.contact import _contact
from fmfts.contact.response import Array, Response

STEPS = 2
NO_SHARE = 0.0  # prior deviation of each shear over the force; 0: none


class Refiner:
    """Refines answers with a pad's response. packed: the response. Nothing is known of shear before."""

    def __init__(self, response: Response) -> None:
        self.response = response
        self.packed = response.packed()

    def refined(self, press: Array, change: Array, covariance: Array, steps: int = STEPS) -> tuple[Array, Array, float]:
        """The most likely press (2 + L,) in mm and N, its covariance, and χ² of what it leaves. press: where to start.

        change (5,): of pose, in mm and components of the axis; covariance (5, 5): ValueError if it is not one.
        """
        found, spread = np.array(press, dtype=float), np.empty((len(press), len(press)))
        change, covariance = np.ascontiguousarray(change, dtype=float), np.ascontiguousarray(covariance, dtype=float)
        chi2 = _contact.refine(
            self.packed, change.data, covariance.ravel().data, steps, NO_SHARE, found.data, spread.ravel().data
        )
        if chi2 is None:
            raise ValueError("a press cannot be refined: the covariance is not positive definite")
        return found, spread, chi2
