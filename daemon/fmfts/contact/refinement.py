"""[pad.contact] refine: the network's answer, moved to the most likely press of the pad's response table."""

from __future__ import annotations

import numpy as np

from fmfts.contact.response import CHANGE, Array, Response, most_likely

try:
    from fmfts.contact import _refine
except ImportError:  # no compiler was there when the package was built
    _refine = None  # type: ignore[assignment]

STEPS = 2
MOST_MONOMIALS = 16


class Refiner:
    """One pad's response, ready to be asked at every frame; by the kernel where there is one."""

    def __init__(self, response: Response) -> None:
        self.response = response
        size_x, size_y, monomials, _ = response.coefficient.shape
        sizes = np.array([size_x - 2, size_y - 2, monomials, response.loads])
        table = np.concatenate([sizes, response.first_mm, response.spacing_mm, [response.scale_n]])
        exponent = np.ascontiguousarray(response.exponent, dtype=np.int32)
        # As refine.h reads it.
        self.packed = table.tobytes() + np.ascontiguousarray(response.coefficient).tobytes() + exponent.tobytes()
        self.compiled = _refine is not None and monomials <= MOST_MONOMIALS

    def refined(self, press: Array, change: Array, covariance: Array, steps: int = STEPS) -> tuple[Array, Array]:
        """The press (2 + L,) in mm and N, and its covariance, from a press near it and a change of pose (5,) in mm and
        numbers of the axis, whose covariance is (5, 5). ValueError where that is no covariance."""
        if not self.compiled:
            return self.reference(press, change, covariance, steps)
        found, spread = np.array(press, dtype=float), np.empty((len(press), len(press)))
        change, covariance = np.ascontiguousarray(change, dtype=float), np.ascontiguousarray(covariance, dtype=float)
        if not _refine.refine(self.packed, change, covariance, steps, found, spread):
            raise ValueError("a press was to be refined with a covariance that is none")
        return found, spread

    def reference(self, press: Array, change: Array, covariance: Array, steps: int = STEPS) -> tuple[Array, Array]:
        """The same in NumPy."""
        whole = np.broadcast_to(covariance, (1, CHANGE, CHANGE))
        found, spread, _ = most_likely(self.response, change[None], whole, press[None], steps)
        return found[0], spread[0]
