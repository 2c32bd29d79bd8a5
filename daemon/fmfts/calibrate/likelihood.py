"""Finds the most likely press of a pose by a search over the whole pad: the reference for all other estimates."""

from __future__ import annotations

import numpy as np

from fmfts.contact.response import Response, most_likely
from fmfts.pad import Array


def invert(response: Response, change: Array, covariance: Array, across: int = 5, steps: int = 40) -> Array:
    """(K, 2 + L) the most likely press of each change (K, 5), searched from `across` × `across` starting places.

    covariance: of the change, (5, 5) or (K, 5, 5).
    """
    whole = np.broadcast_to(covariance, (len(change), 5, 5))
    best = np.empty((len(change), 2 + response.loads))
    smallest = np.full(len(change), np.inf)
    places = [np.linspace(*ends, across + 2)[1:-1] for ends in zip(response.first_mm, response.last_mm, strict=True)]
    for x_mm in places[0]:
        for y_mm in places[1]:
            start = np.tile([x_mm, y_mm, response.scale_n / 2.0, *np.zeros(response.loads - 1)], (len(change), 1))
            press, _, chi2 = most_likely(response, change, whole, start, steps)
            better = chi2 < smallest
            best[better], smallest[better] = press[better], chi2[better]
    return best
