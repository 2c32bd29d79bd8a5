"""The bench of a second weight: what it reads away from the middle on a pad of the model's own thickness."""

from __future__ import annotations

import numpy as np

from fmfts_lab.bench.second_weight import WEIGHT_N, readings


def test_weight_is_read_at_each_place() -> None:
    read = np.array(readings(4.0, seed=1))
    assert read.shape == (4,)
    assert np.abs(read[:2] / WEIGHT_N - 1.0).max() < 0.15
    assert np.abs(read / WEIGHT_N - 1.0).max() < 0.6
