"""Touch and its gates against SciPy's χ², and the filter of poses against least squares with fading weights."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from fmfts.contact import Smoother, TouchDetector
from fmfts.contact.touch import chi2_from_rest
from oracle.field import Array

RATE_HZ = 220.0


def covariance_of(random: np.random.Generator, size: int = 5) -> Array:
    scale = np.array([1e-5, 1e-5, 4e-6, 2e-3, 2e-3])[:size]
    mixed = np.eye(size) + 0.3 * random.normal(size=(size, size))
    return np.asarray((mixed @ mixed.T) * scale[:, None] * scale)


def test_chi2_from_rest_is_that_of_the_inverse() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        covariance = covariance_of(random)
        moved = np.linalg.cholesky(covariance) @ random.normal(size=5) * 3.0
        assert chi2_from_rest(moved, covariance) == pytest.approx(moved @ np.linalg.solve(covariance, moved), rel=1e-9)


def test_touch_begins_and_ends_as_docs_say() -> None:
    """Once an hour an unloaded pad exceeds the onset; five frames within the nearest 99 % end it."""
    random, detector, touched, quiet = np.random.default_rng(2), TouchDetector(RATE_HZ), False, 0
    onset, release = chi2.isf(1.0 / 3600.0 / RATE_HZ, 5), chi2.isf(0.01, 5)
    covariance, changes = covariance_of(random), 0
    root = np.linalg.cholesky(covariance)
    for frame in range(3000):
        size = 12.0 if frame % 200 < 60 else 1.0 if frame % 200 < 150 else 2.2
        moved = root @ random.normal(size=5) * size
        distance = float(moved @ np.linalg.solve(covariance, moved))
        quiet = quiet + 1 if distance < release else 0
        before, touched = touched, distance > onset or (touched and quiet < 5)
        changes += before != touched
        assert detector.update(moved, covariance) == touched
    assert changes > 20
    assert detector.longest_gap_s == pytest.approx(5.5 / RATE_HZ)


def test_smoothed_pose_is_the_parabola_of_fading_least_squares() -> None:
    """Morrison (1969): with weights θ^k, where the start is forgotten. 0.03 s of memory, 400 frames."""
    random, memory_s, count = np.random.default_rng(3), 0.03, 400
    time_s = np.arange(count) / RATE_HZ
    covariance = np.diag([1e-5, 1e-5, 4e-6, 2e-3, 2e-3, 1e-9]) ** 2
    poses = np.zeros((count, 6))
    poses[:, 2], poses[:, 5] = 12e-3, 1.0
    poses[:, 0] = 1e-5 * np.sin(5.0 * time_s) + 1e-6 * random.normal(size=count)
    smoother = Smoother(memory_s)
    for pose in poses:
        told = smoother.update(pose[:3], pose[3:], covariance, 1.0 / RATE_HZ)[0]
    ago = (time_s - time_s[-1]) / memory_s
    weight = np.exp(0.5 * ago)  # polyfit squares it
    assert told[0] == pytest.approx(np.polyval(np.polyfit(ago, poses[:, 0], 2, w=weight), 0.0), abs=1e-12)
