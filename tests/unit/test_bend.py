"""A contact model bends over the deviations of a pose: its deviations must also hold for the larger force."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.contact import ContactModel
from fmfts.contact.inference import CompiledInference, Inference
from fmfts.contact.model import POSE_UNIT
from fmfts.pad import Pad
from fmfts_calibrate.dataset import standard_pad
from fmfts_simulation.solved_table import standard_mechanics

BEND_DEVIATIONS, STRAIGHT_SHARE = 3.0, 0.02  # estimate.c
# What bare and rest leave of the pose of a firm press, with gains of 5 % and chips turned by 1.5°.
VAGUE = np.diag(np.array([5e-6, 5e-6, 1e-5, 1e-3, 1e-3, 1e-5]) ** 2)
CERTAIN = 1e-4 * VAGUE
KNOWN = np.zeros((6, 6))
UNIT = np.array([1e-3, 1e-3, 1.0])  # mm → m


@pytest.fixture
def pad() -> Pad:
    return standard_pad()


@pytest.fixture
def model(pad: Pad) -> ContactModel:
    return ContactModel.load("default", pad)


def presses() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(5)
    return *random.uniform(-8e-3, 8e-3, (2, 60)), random.uniform(0.3, 1.2, 60)


def poses(pad: Pad) -> list[tuple[np.ndarray, np.ndarray]]:
    moved, axes = standard_mechanics().displacement(*presses())
    return [(pad.rest_position_m + move, axis) for move, axis in zip(moved, axes, strict=True)]


def slope(model: ContactModel, pose: np.ndarray) -> np.ndarray:
    """(3, 6) in SI, by the pose (6,) in SI."""
    return np.asarray(model._infer(pose * POSE_UNIT)[1] * UNIT[:, None] * POSE_UNIT)


def towards_force(by_pose: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(6,) how far the most likely pose is of a force that is larger by BEND_DEVIATIONS."""
    along = covariance @ by_pose[2]
    return np.asarray(along / np.sqrt(by_pose[2] @ along) * BEND_DEVIATIONS)


def own(model: ContactModel, position_m: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(3,) deviations for a pose that is known exactly."""
    return model.estimate(position_m, axis, KNOWN).deviations


def carried(model: ContactModel, position_m: np.ndarray, axis: np.ndarray, by_pose: np.ndarray) -> np.ndarray:
    """(3,) deviations by this slope (3, 6), and the model's own."""
    of_pose = np.einsum("ij,jk,ik->i", by_pose, VAGUE, by_pose)
    return np.asarray(np.sqrt(of_pose + own(model, position_m, axis) ** 2))


def misjudged(model: ContactModel, pad: Pad) -> np.ndarray:
    """(K, 2) the error of a force in its deviations, if the pose is wrong by BEND_DEVIATIONS along the force: as
    published, and by the slope at the found pose alone."""
    off = []
    for position_m, axis in poses(pad):
        truth = model.estimate(position_m, axis, VAGUE)
        step = towards_force(slope(model, np.concatenate([position_m, axis])), VAGUE)
        place_m, tilt = position_m - step[:3], axis - step[3:]
        found = model.estimate(place_m, tilt, VAGUE)
        straight = carried(model, place_m, tilt, slope(model, np.concatenate([place_m, tilt])))[2]
        off.append((truth.force_n - found.force_n) / np.array([found.force_sd_n, straight]))
    return np.array(off)


def test_underestimated_force_is_within_deviations(model: ContactModel, pad: Pad) -> None:
    """The direction of the step is that at the true pose; at the found one it is a little different.

    By the slope at the found pose alone, three deviations would be more than six.
    """
    off, straight = misjudged(model, pad).T
    assert (off < 1.4 * BEND_DEVIATIONS).all()
    assert straight.max() > 2.0 * BEND_DEVIATIONS
    assert (straight >= off - 1e-4).all()


def test_bend_widens_deviations_by_little_and_never_narrows(model: ContactModel, pad: Pad) -> None:
    ratio = []
    for position_m, axis in poses(pad):
        straight = carried(model, position_m, axis, slope(model, np.concatenate([position_m, axis])))
        ratio.append(model.estimate(position_m, axis, VAGUE).deviations / straight)
    assert (np.array(ratio) >= 1.0 - 1e-6).all()
    assert np.median(np.array(ratio)[:, 2]) < 1.3


def bends(model: ContactModel, position_m: np.ndarray, axis: np.ndarray) -> bool:
    """Whether the bend of a vague pose matters."""
    by_force = slope(model, np.concatenate([position_m, axis]))[2]
    return bool(np.sqrt(by_force @ VAGUE @ by_force) > STRAIGHT_SHARE * model.estimate(position_m, axis, VAGUE).force_n)


def test_deviation_is_that_of_the_mean_of_both_slopes(model: ContactModel, pad: Pad) -> None:
    bent = [pose for pose in poses(pad) if bends(model, *pose)]
    assert 40 < len(bent) < 55
    for position_m, axis in bent:
        pose = np.concatenate([position_m, axis])
        here = slope(model, pose)
        mean = 0.5 * (here + slope(model, pose + towards_force(here, VAGUE)))
        expected = max(carried(model, position_m, axis, each)[2] for each in (here, mean))
        assert model.estimate(position_m, axis, VAGUE).force_sd_n == pytest.approx(expected, rel=1e-5)


class Counted(Inference):
    """Counts how often it is asked."""

    def __init__(self, inner: CompiledInference) -> None:
        super().__init__(outputs=len(inner.contact))
        self._inner, self.asked = inner, 0

    def run(self) -> None:
        self.asked += 1
        self._inner.pose[:] = self.pose
        self._inner.run()
        self.contact[:], self.jacobian[:] = self._inner.contact, self._inner.jacobian


def test_certain_pose_needs_no_second_slope(model: ContactModel, pad: Pad) -> None:
    """Such a frame costs as much as before, and the second slope would hardly change its deviation."""
    assert isinstance(model.inference, CompiledInference)
    vague = [model.estimate(*pose, VAGUE) for pose in poses(pad)]
    twice = [bends(model, *pose) for pose in poses(pad)]
    model.inference = counted = Counted(model.inference)
    for position_m, axis in poses(pad):
        found = model.estimate(position_m, axis, CERTAIN)
        pose = np.concatenate([position_m, axis])
        here = slope(model, pose)
        mean = 0.5 * (here[2] + slope(model, pose + towards_force(here, CERTAIN))[2])
        always = np.sqrt(mean @ CERTAIN @ mean + own(model, position_m, axis)[2] ** 2)
        assert found.force_sd_n == pytest.approx(always, rel=0.05)
    counted.asked = 0
    for pose in poses(pad):
        model.estimate(*pose, CERTAIN)
    assert counted.asked == len(vague)
    again = [model.estimate(*pose, VAGUE) for pose in poses(pad)]
    assert counted.asked == 2 * len(vague) + sum(twice)
    assert [one.force_sd_n for one in again] == [one.force_sd_n for one in vague]
