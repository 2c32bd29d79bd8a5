"""[pad.contact] refine: moves the network's answer to the most likely press, with the table of the pad's response."""

from __future__ import annotations

import numpy as np

from fmfts.contact import _contact
from fmfts.contact.response import Array, Response

STEPS = 2


class Refiner:
    """Refines answers with a pad's response. packed: the response as in refine.h."""

    def __init__(self, response: Response) -> None:
        self.response = response
        self.packed = packed(response)

    def refined(self, press: Array, change: Array, covariance: Array, steps: int = STEPS) -> tuple[Array, Array]:
        """The most likely press (2 + L,) in mm and N, and its covariance. press (2 + L,): where to start.

        change (5,): of pose, in mm and components of the axis; covariance (5, 5): ValueError if it is not one.
        """
        found, spread = np.array(press, dtype=float), np.empty((len(press), len(press)))
        change, covariance = np.ascontiguousarray(change, dtype=float), np.ascontiguousarray(covariance, dtype=float)
        if not _contact.refine(
            self.packed, change.data, covariance.ravel().data, steps, found.data, spread.ravel().data
        ):
            raise ValueError("a press cannot be refined: the covariance is not positive definite")
        return found, spread


def packed(response: Response) -> bytes:
    """As refine.h reads it."""
    size_x, size_y, monomials, _ = response.coefficient.shape
    sizes = np.array([size_x - 2, size_y - 2, monomials, response.loads])
    table = np.concatenate([sizes, response.first_mm, response.spacing_mm, [response.scale_n]])
    exponent = np.ascontiguousarray(response.exponent, dtype=np.int32)
    return table.tobytes() + np.ascontiguousarray(response.coefficient).tobytes() + exponent.tobytes()
