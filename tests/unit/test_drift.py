"""The follower of a slow drift, window by window."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.baseline.drift import DriftFollower, Quiet
from fmfts.pad import DriftLimits, Pad
from fmfts.pose import State

LIMITS = DriftLimits(quiet_s=5.0, rate_m_per_s=1e-5, limit_m=10e-6, force_below_n=0.1)


def window(follower: DriftFollower, rest: State, begin_s: float, sunk_m: float) -> list[bool]:
    """A little more than `quiet_s` of readings at one place."""
    place = rest.position_m - np.array([0.0, 0.0, sunk_m])
    return [follower.saw(Quiet(begin_s + time_s, place, rest.axis, 0.0, 0.01)) for time_s in np.linspace(0.0, 5.01, 40)]


def test_last_step_onto_the_limit_is_taken_however_small(pad: Pad) -> None:
    rest = State.at_rest(pad)
    follower = DriftFollower(rest, LIMITS)
    assert any(window(follower, rest, 0.0, 9.95e-6))
    assert any(window(follower, rest, 10.0, 12e-6))
    assert follower.size_m == pytest.approx(10e-6, rel=1e-9)


def test_drift_stops_at_the_limit(pad: Pad) -> None:
    rest = State.at_rest(pad)
    follower = DriftFollower(rest, LIMITS)
    assert any(window(follower, rest, 0.0, 12e-6))
    assert not any(window(follower, rest, 10.0, 12e-6))
    assert not any(window(follower, rest, 20.0, 13e-6))
