"""The change of a pose since rest: change.c for pads with one magnet, against change.py for all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pose_steps_in_c import Displaced

from fmfts.pad import Pad
from fmfts.pose import PoseEstimate, State, displacement, in_nominal_frame, solve, widened
from fmfts.pose.change import distance
from fmfts.pose.field_errors import change_since


def estimate_at(pad: Pad, state: State, random: np.random.Generator) -> PoseEstimate:
    """Of any covariance."""
    root = random.normal(size=(14, 14)) * np.array([1e-5] * 3 + [2e-3] * 2 + [1e-3] + [1e-7] * 8)[:, None]
    return replace(solve(np.zeros((4, 3)), pad, state, free=np.arange(0)), state=state, covariance=root @ root.T)


@pytest.mark.parametrize("seed", range(20))
def test_change_in_c_is_that_of_pads_with_several_magnets(pad: Pad, seed: int) -> None:
    """With what a baseline has left, and in the drawing's frame."""
    random = np.random.default_rng(seed)
    tilt = np.append(0.03 * random.normal(size=5), 0.0) * [1e-2, 1e-2, 1e-2, 1.0, 1.0, 0.0]
    rest = State.at_rest(pad).stepped(tilt)
    press = random.normal(size=9) * [3e-4, 3e-4, 1e-3, 0.1, 0.1, 0.01, 3e-5, 3e-5, 3e-5]
    estimate = estimate_at(pad, rest.stepped(press), random)
    leftover = random.normal(size=(8, 5, 9)) * np.array([1e-2] * 3 + [1.0] * 2)[:, None]
    found = Displaced(rest, pad, leftover, estimate)
    error = np.tensordot(change_since(rest, estimate.state), leftover, axes=1)
    wider = widened(estimate, rest, error @ error.T)
    change, covariance = displacement(wider, rest)
    np.testing.assert_allclose(found.change, change, rtol=1e-12, atol=1e-18)
    scale = np.sqrt(np.diagonal(covariance))
    np.testing.assert_allclose(found.at_rest / scale / scale[:, None], covariance / scale / scale[:, None], atol=1e-9)
    np.testing.assert_allclose(found.distance(), distance(change, covariance), rtol=1e-9)
    position_m, axis, spread = in_nominal_frame(wider, rest, pad)
    pose, in_drawing = found.drawn()
    np.testing.assert_allclose(pose, [*position_m, *axis], rtol=1e-12, atol=1e-15)
    scale = np.sqrt(np.diagonal(spread) + 1e-24)
    np.testing.assert_allclose(in_drawing / scale / scale[:, None], spread / scale / scale[:, None], atol=1e-9)


def test_change_of_nothing_is_as_far_as_its_largest_deviation(pad: Pad) -> None:
    """It has no direction."""
    rest = State.at_rest(pad)
    estimate = estimate_at(pad, rest, np.random.default_rng(1))
    moved_m, deviation_m = Displaced(rest, pad, np.zeros((8, 5, 0)), estimate).distance()
    assert moved_m == 0.0
    assert deviation_m == pytest.approx(np.sqrt(np.diagonal(estimate.covariance)[:3].max()))
