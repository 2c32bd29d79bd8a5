"""Touch and its gates against SciPy's χ², and the filter of poses against least squares with fading weights."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from scipy.special import chdtri as chi2_of_tail

from fmfts.common.record import Record
from fmfts.contact import TouchDetector
from fmfts.contact._contact import PARAMETERS
from fmfts.pose.gates import JUMP_PROBABILITY
from oracle.compiled import library_of, memory_between, part_of, pointer
from oracle.field import Array

RATE_HZ = 220.0


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    library = library_of(tmp_path_factory.mktemp("touch"), "contact/touch.c", "contact/smooth.c", "arithmetic/matrix.c")
    library.fmfts_chi2_from_rest.restype = library.fmfts_touch.restype = ctypes.c_bool
    library.fmfts_smooth.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
    return library


def covariance_of(random: np.random.Generator, magnets: int = 1) -> Array:
    scale = np.tile([1e-5, 1e-5, 4e-6, 2e-3, 2e-3], magnets)
    mixed = np.eye(len(scale)) + 0.3 * random.normal(size=(len(scale), len(scale)))
    return np.asarray((mixed @ mixed.T) * scale[:, None] * scale)


@pytest.mark.parametrize("magnets", [1, 4, 9])
def test_chi2_from_rest_is_that_of_the_inverse(compiled: ctypes.CDLL, magnets: int) -> None:
    random, numbers = np.random.default_rng(1), 5 * magnets
    for _ in range(50):
        covariance, found = covariance_of(random, magnets), np.zeros(1)
        moved = np.linalg.cholesky(covariance) @ random.normal(size=numbers) * 3.0
        assert compiled.fmfts_chi2_from_rest(numbers, pointer(moved), pointer(covariance), pointer(found))
        assert found[0] == pytest.approx(moved @ np.linalg.solve(covariance, moved), rel=1e-9)
    assert not compiled.fmfts_chi2_from_rest(numbers, pointer(moved), pointer(-covariance), pointer(found))


def test_touch_begins_and_ends_as_docs_say(compiled: ctypes.CDLL) -> None:
    """Once an hour an unloaded pad exceeds the onset; five frames within the nearest 99 % end it. Of one magnet and of
    several."""
    random, detector, touched, quiet = np.random.default_rng(2), TouchDetector(RATE_HZ), False, 0
    onset, release = chi2_of_tail(5, 1.0 / 3600.0 / RATE_HZ), chi2_of_tail(5, 0.01)
    assert detector.onset_chi2 == pytest.approx(onset, rel=1e-9)
    assert detector.release_chi2 == pytest.approx(release, rel=1e-9)
    assert detector.longest_gap_s == pytest.approx(5.5 / RATE_HZ)
    parameters, memory = Record(PARAMETERS), memory_between("touched", "acceleration")
    parameters.fill({"onset_chi2": detector.onset_chi2, "release_chi2": detector.release_chi2})
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
        assert compiled.fmfts_touch(part_of(parameters), part_of(memory), 5, pointer(moved), pointer(covariance))
        assert bool(memory.number("touched")) == touched
        assert memory.number("quiet_frames") == quiet
    assert changes > 20


def test_smoothed_pose_is_the_parabola_of_fading_least_squares(compiled: ctypes.CDLL) -> None:
    """Morrison (1969): with weights θ^k, after the start is forgotten. 0.03 s of memory, 400 frames."""
    random, memory_s, count = np.random.default_rng(3), 0.03, 400
    time_s = np.arange(count) / RATE_HZ
    in_its_units = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
    covariance = np.diag(in_its_units * [1e-5, 1e-5, 4e-6, 2e-3, 2e-3, 1e-9]) ** 2
    poses = np.zeros((count, 6))
    poses[:, 2], poses[:, 5] = 12e-3, 1.0
    poses[:, 0] = 1e-5 * np.sin(5.0 * time_s) + 1e-6 * random.normal(size=count)
    parameters, memory = Record(PARAMETERS), memory_between("touched", "acceleration")
    parameters.fill({"smoothing_s": memory_s, "smoothing_jump_chi2": chi2_of_tail(5, JUMP_PROBABILITY)})
    for pose in poses:
        question = np.concatenate([pose * in_its_units, covariance.ravel(), np.zeros(2)])
        compiled.fmfts_smooth(part_of(parameters), part_of(memory), 1.0 / RATE_HZ, pointer(question))
    ago = (time_s - time_s[-1]) / memory_s
    weight = np.exp(0.5 * ago)  # polyfit squares it
    parabola = np.polyval(np.polyfit(ago, poses[:, 0], 2, w=weight), 0.0)
    assert question[0] * 1e-3 == pytest.approx(parabola, abs=1e-12)
