"""Finds the most likely press of a pose by a search over the whole pad: the reference for all other estimates."""

from __future__ import annotations

import numpy as np

from fmfts.contact.refinement import Refiner
from fmfts.contact.response import Response
from fmfts.pad import Array


def invert(response: Response, change: Array, covariance: Array, across: int = 5, steps: int = 40) -> Array:
    """(K, 2 + L) the most likely press of each change (K, 5), searched from `across` × `across` starting places.

    covariance: of the change, (5, 5) or (K, 5, 5).
    """
    whole, refiner = np.broadcast_to(covariance, (len(change), 5, 5)), Refiner(response)
    places = [np.linspace(*ends, across + 2)[1:-1] for ends in zip(response.first_mm, response.last_mm, strict=True)]
    loads = [response.scale_n / 2.0, *np.zeros(response.loads - 1)]
    starts = [np.array([x_mm, y_mm, *loads]) for x_mm in places[0] for y_mm in places[1]]
    best = []
    for moved, uncertain in zip(change, whole, strict=True):
        found = (refiner.refined(start, moved, uncertain, steps) for start in starts)
        best.append(min(found, key=lambda one: one[2])[0])
    return np.array(best).reshape(len(change), 2 + response.loads)
