"""Estimates the error of a fitted response from presses left out of the fit, and the errors it causes in answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.contact.contract import ErrorTables
from fmfts.contact.response import SHARE_OF_CONE, Response
from fmfts.pad import Array
from fmfts_calibrate.bounds import answer_by_change
from fmfts_calibrate.evaluation import ForceBins, tables_of_squares
from fmfts_calibrate.fitting import left_out_residuals
from fmfts_calibrate.samples import Samples

# The response's error at a place is estimated from so many presses around it: enough for a deviation to 15 %.
NEIGHBOURS = 24
LEAST_FORCE_N = 0.01  # smallest force of the prior of shear


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Presses that were left out of fits.

    press (K, 2 + L). residual (K, 5): their change of pose minus that of the response fitted without them. deviation
    (K, 5): standard deviation by one frame's noise.
    """

    press: Array
    residual: Array
    deviation: Array

    @classmethod
    def of(
        cls, press: Array, change: Array, deviation: Array, roughness: float, empty: Response | None = None
    ) -> LeftOut:
        rows, residual = left_out_residuals(press, change, deviation, roughness, empty)
        return cls(press[rows], residual, deviation[rows])

    @property
    def in_deviations(self) -> float:
        """Rms of residual / deviation."""
        return float(np.sqrt(np.mean((self.residual / self.deviation) ** 2)))

    def covariance(self, press: Array) -> Array:
        """(K, 5, 5) covariance of the response's error under presses (K, 2 + L): that of the nearest left-out presses,
        in proportion to the force, because an unloaded pad is exactly at rest."""
        nearest = _nearest(self.press[:, :2], press[:, :2])
        outer = np.einsum("ki,kj->kij", self.residual, self.residual)
        share = press[:, 2] ** 2 / np.sum(self.press[nearest, 2] ** 2, axis=1)
        covariance: Array = outer[nearest].sum(axis=1) * share[:, None, None]
        return covariance

    def error(self, response: Response, samples: Samples, bins: ForceBins) -> ErrorTables:
        """The error of the most likely answers that the response's error causes, in bins of `samples`. Their shear is
        known beforehand to be within the calibrated friction."""
        shear_sd_n = SHARE_OF_CONE * response.friction * np.maximum(samples.press[:, 2], LEAST_FORCE_N)
        known_to = shear_sd_n if response.loads > 1 else np.inf
        gain = answer_by_change(response.change_and_slope(samples.press)[1], samples.covariance, known_to)
        square = np.einsum("kmi,kij,kmj->km", gain, self.covariance(samples.press), gain)
        return tables_of_squares(bins, samples.press, square)


def _nearest(known: Array, queries: Array) -> Array:
    """(K, n) rows of `known` (N, 2) that are nearest to each of `queries` (K, 2)."""
    count = min(NEIGHBOURS, len(known))
    parts = np.array_split(queries, max(len(queries) // 1000, 1))
    distances = (np.linalg.norm(part[:, None] - known, axis=2) for part in parts)
    return np.concatenate([np.argpartition(distance, count - 1, axis=1)[:, :count] for distance in distances])
