"""A contact model bends over the deviations of a pose: its deviations must hold for the larger force, too."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.calibrate.dataset import standard_pad
from fmfts.contact import ContactModel
from fmfts.contact.bend import BEND_DEVIATIONS, STRAIGHT_SHARE
from fmfts.pad import Pad
from fmfts.simulation.solved_table import standard_mechanics

# What bare and rest leave of the pose of a firm press, with gains of 5 % and chips turned by 1.5°.
VAGUE = np.diag(np.array([5e-6, 5e-6, 1e-5, 1e-3, 1e-3, 1e-5]) ** 2)
CERTAIN = 1e-4 * VAGUE


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


def misjudged(model: ContactModel, pad: Pad) -> np.ndarray:
    """(K,) how many of its deviations a force is off, if the pose is off by BEND_DEVIATIONS along the force."""
    off = []
    for position_m, axis in poses(pad):
        truth = model.estimate(position_m, axis, VAGUE)
        by_force = model.slope()[2]
        step = VAGUE @ by_force / np.sqrt(by_force @ VAGUE @ by_force) * BEND_DEVIATIONS
        found = model.estimate(position_m - step[:3], axis - step[3:], VAGUE)
        off.append((truth.force_n - found.force_n) / found.force_sd_n)
    return np.array(off)


def test_force_that_is_taken_for_a_smaller_one_is_within_its_deviations(
    model: ContactModel, pad: Pad, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The direction of the step is that at the true pose; at the found one it is a little different.

    By the slope at the found pose alone, three deviations would be more than six.
    """
    off = misjudged(model, pad)
    assert (off < 1.4 * BEND_DEVIATIONS).all()
    monkeypatch.setattr("fmfts.contact.model.larger_force", lambda *_: None)
    straight = misjudged(model, pad)
    assert straight.max() > 2.0 * BEND_DEVIATIONS
    assert (straight >= off - 1e-9).all()


def test_bend_widens_deviations_by_little_and_never_narrows_them(
    model: ContactModel, pad: Pad, monkeypatch: pytest.MonkeyPatch
) -> None:
    bent = [model.estimate(*pose, VAGUE).covariance for pose in poses(pad)]
    monkeypatch.setattr("fmfts.contact.model.larger_force", lambda *_: None)
    straight = [model.estimate(*pose, VAGUE).covariance for pose in poses(pad)]
    ratio = np.array(
        [np.sqrt(np.diagonal(one) / np.diagonal(other)) for one, other in zip(bent, straight, strict=True)]
    )
    assert (ratio >= 1.0 - 1e-12).all()
    assert np.median(ratio[:, 2]) < 1.3


def test_certain_pose_does_not_ask_for_a_second_slope(
    model: ContactModel, pad: Pad, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such a frame costs what it did, and the second slope would change its deviation by next to nothing."""
    with_rule = [model.estimate(*pose, CERTAIN) for pose in poses(pad)]
    monkeypatch.setattr("fmfts.contact.bend.STRAIGHT_SHARE", 0.0)
    always = [model.estimate(*pose, CERTAIN) for pose in poses(pad)]
    for one, other in zip(with_rule, always, strict=True):
        np.testing.assert_allclose(one.force_sd_n, other.force_sd_n, rtol=0.05)
    assert STRAIGHT_SHARE > 0.0
    monkeypatch.undo()
    asked: list[np.ndarray] = []
    infer = model._infer
    monkeypatch.setattr(model, "_infer", lambda pose: asked.append(pose) or infer(pose))
    for pose in poses(pad):
        model.estimate(*pose, CERTAIN)
    assert len(asked) == len(poses(pad))
