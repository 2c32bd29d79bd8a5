"""What the fit of a pad's response leaves open: the presses that it was not told, and what that costs an answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.calibrate.evaluation import ForceBins, tables_of_squares
from fmfts.calibrate.fitting import left_out_residuals
from fmfts.calibrate.samples import Samples
from fmfts.contact.contract import ErrorTables
from fmfts.contact.response import Response, answer_by_change
from fmfts.pad import Array

# Presses about a place that tell how well the response is known there: enough for a deviation to 15 %.
NEIGHBOURS = 24


@dataclass(frozen=True, slots=True)
class LeftOut:
    """press (K, 2 + L) that folds left out; residual (K, 5): what the change of pose was beyond the response's without
    them; deviation (K, 5): of one frame's noise."""

    press: Array
    residual: Array
    deviation: Array

    @classmethod
    def of(cls, press: Array, change: Array, deviation: Array, roughness: float) -> LeftOut:
        rows, residual = left_out_residuals(press, change, deviation, roughness)
        return cls(press[rows], residual, deviation[rows])

    @property
    def in_deviations(self) -> float:
        """Rms of the residuals over the noise of one frame."""
        return float(np.sqrt(np.mean((self.residual / self.deviation) ** 2)))

    def covariance(self, press: Array) -> Array:
        """(K, 5, 5) of the response's error under presses (K, 2 + L): as at the nearest places, in proportion to the
        force, for an unloaded pad is exactly at rest."""
        nearest = _nearest(self.press[:, :2], press[:, :2])
        outer = np.einsum("ki,kj->kij", self.residual, self.residual)
        share = press[:, 2] ** 2 / np.sum(self.press[nearest, 2] ** 2, axis=1)
        covariance: Array = outer[nearest].sum(axis=1) * share[:, None, None]
        return covariance

    def error(self, response: Response, samples: Samples, bins: ForceBins) -> ErrorTables:
        """That error as it reaches the most likely presses of `samples`, in bins."""
        gain = answer_by_change(response.change_and_slope(samples.press)[1], samples.covariance)
        square = np.einsum("kmi,kij,kmj->km", gain, self.covariance(samples.press), gain)
        return tables_of_squares(bins, samples.press, square)


def _nearest(known: Array, asked: Array) -> Array:
    """(K, n) rows of `known` (N, 2) that are nearest to each of `asked` (K, 2)."""
    count = min(NEIGHBOURS, len(known))
    parts = np.array_split(asked, max(len(asked) // 1000, 1))
    distances = (np.linalg.norm(part[:, None] - known, axis=2) for part in parts)
    return np.concatenate([np.argpartition(distance, count - 1, axis=1)[:, :count] for distance in distances])
