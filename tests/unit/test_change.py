"""The change of a pose since rest: change.c against derivatives by differences, and SciPy's rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pose_steps_in_c import Displaced
from scipy.spatial.transform import Rotation

from fmfts.pad import Array, Pad, Silicone
from fmfts.pipeline import _pad
from fmfts.pipeline.drawn import NominalFrame, in_nominal_frame
from fmfts.pose import PoseEstimate, State, solve
from fmfts.pose.change import change_since
from oracle.field import differences, tangents, turned

STEPS = np.array([1e-6] * 3 + [1e-4] * 2)


def estimate_at(pad: Pad, state: State, random: np.random.Generator) -> PoseEstimate:
    """Of any covariance."""
    root = random.normal(size=(14, 14)) * np.array([1e-5] * 3 + [2e-3] * 2 + [1e-3] + [1e-7] * 8)[:, None]
    return replace(solve(np.zeros((4, 3)), pad, state, free=np.arange(0)), state=state, covariance=root @ root.T)


def near(told: Array, wanted: Array) -> None:
    """Two covariances, by their deviations."""
    scale = np.sqrt(np.diagonal(wanted) + 1e-24)
    np.testing.assert_allclose(told / scale / scale[:, None], wanted / scale / scale[:, None], atol=1e-7)


@pytest.mark.parametrize("seed", range(20))
def test_change_and_its_covariance_are_those_of_a_small_step(pad: Pad, seed: int) -> None:
    """With what a baseline has left, which is proportional to the change, and in the drawing's frame."""
    random = np.random.default_rng(seed)
    tilt = np.append(0.03 * random.normal(size=5), 0.0) * [1e-2, 1e-2, 1e-2, 1.0, 1.0, 0.0]
    rest = State.at_rest(pad).stepped(tilt)
    press = random.normal(size=9) * [3e-4, 3e-4, 1e-3, 0.1, 0.1, 0.01, 3e-5, 3e-5, 3e-5]
    estimate = estimate_at(pad, rest.stepped(press), random)
    leftover = random.normal(size=(8, 5, 9)) * np.array([1e-2] * 3 + [1.0] * 2)[:, None]
    cross, along = np.cross(rest.axis, pad.rest_axis), rest.axis @ pad.rest_axis
    pad_turn = Rotation.from_rotvec(0.05 * random.normal(size=3)).as_matrix()
    rotation = Rotation.from_rotvec(cross / np.linalg.norm(cross) * np.arctan2(np.linalg.norm(cross), along))

    def change(step: Array) -> Array:
        moved = estimate.position_m + step[:3] - rest.position_m
        return np.concatenate([moved, tangents(rest.axis).T @ turned(estimate.axis, step[3:])])

    def drawn(step: Array) -> Array:
        moved = estimate.position_m + step[:3] - rest.position_m
        return np.concatenate([pad.rest_position_m + pad_turn @ moved, rotation.apply(turned(estimate.axis, step[3:]))])

    here, found = np.zeros(5), Displaced(rest, pad, leftover, estimate, pad_turn)
    np.testing.assert_allclose(found.change, change(here), rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(
        change_since(rest, estimate.state), [*change(here), *estimate.state.ambient_t], atol=1e-16
    )
    J, D = differences(change, here, STEPS), differences(drawn, here, STEPS)
    error = np.tensordot(change_since(rest, estimate.state), leftover, axes=1)
    own, left = estimate.covariance[:5, :5], error @ error.T
    at_rest = J @ own @ J.T + J @ tilted_back(rest, estimate) @ left @ tilted_back(rest, estimate).T @ J.T
    near(found.at_rest, at_rest)
    moved, spread = change(here)[:3], at_rest[:3, :3]
    expected = np.linalg.norm(moved), np.sqrt(moved @ spread @ moved) / np.linalg.norm(moved)
    np.testing.assert_allclose(found.distance(), expected, rtol=1e-6)
    np.testing.assert_allclose(_pad.distance(change(here), at_rest), expected, rtol=1e-9)
    plain, share = in_nominal_frame(estimate, rest, pad, pad_turn), 0.02**2 + 0.01**2
    with_leftover = NominalFrame(rest, pad, leftover, pad_turn=pad_turn).pose(estimate)
    with_all = NominalFrame(rest, pad, leftover, Silicone(0.02, 0.01), pad_turn).pose(estimate)
    back = D @ tilted_back(rest, estimate)
    for told, wanted in (
        (plain, D @ own @ D.T),
        (with_leftover, D @ own @ D.T + back @ left @ back.T),
        (with_all, D @ own @ D.T + back @ (left + share * np.outer(change(here), change(here))) @ back.T),
    ):
        np.testing.assert_allclose(np.concatenate(told[:2]), drawn(here), rtol=1e-12, atol=1e-15)
        near(told[2], wanted)
    near(found.drawn()[1], with_leftover[2])


def tilted_back(rest: State, estimate: PoseEstimate) -> Array:
    """(5, 5) a step of the rest's tangents as one of the estimate's: their projection."""
    turn = np.eye(5)
    turn[3:, 3:] = tangents(estimate.axis).T @ tangents(rest.axis)
    return turn


def test_zero_change_is_as_uncertain_as_its_largest_deviation(pad: Pad) -> None:
    """A zero change has no direction."""
    rest = State.at_rest(pad)
    estimate = estimate_at(pad, rest, np.random.default_rng(1))
    moved_m, deviation_m = Displaced(rest, pad, np.zeros((8, 5, 0)), estimate).distance()
    assert moved_m == 0.0
    assert deviation_m == pytest.approx(np.sqrt(np.diagonal(estimate.covariance)[:3].max()))
