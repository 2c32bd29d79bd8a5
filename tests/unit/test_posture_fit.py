"""What a minute of a moving hand teaches. The hand is dipoles on two joints (tests/emulator/hand_magnets.py)."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from emulator.hand_magnets import NAMES, HandMagnets
from fmfts.baseline import BaselineError
from fmfts.baseline.joint_track import JointTrack
from fmfts.baseline.posture import StoredPosture
from fmfts.baseline.posture_fit import Taught, fit_posture
from fmfts.pad import Array, Pad
from fmfts.pose.posture import OTHER_SCALE, PostureModel

NOISE_T = 1e-7
HAND = HandMagnets(period_s=4.0)


def rows(pad: Pad, seconds: float, count: int, hand: HandMagnets = HAND, seed: int = 1) -> tuple[Array, Array]:
    """Joints (K, 3) and the change of the field (K, 12) since the start."""
    sensors = pad.sensors.position_m
    times = np.linspace(0.0, seconds, count)
    fields = np.array([hand.field(sensors, np.full(len(sensors), time)).ravel() for time in times])
    joints = np.array([[hand.joints_rad(time)[name] for name in NAMES] for time in times])
    noise = np.random.default_rng(seed).normal(0.0, NOISE_T, fields.shape)
    return joints, fields - fields[0] + noise


def by_ambient(pad: Pad) -> Array:
    return pad.sensors.axes.transpose(0, 2, 1).reshape(-1, 3)


def without_even(change: Array, by_ambient: Array) -> Array:
    return change - (by_ambient @ np.linalg.lstsq(by_ambient, change.T, rcond=None)[0]).T


@pytest.fixture
def taught(pad: Pad) -> Taught:
    joints, change = rows(pad, 60.0, 500)
    return fit_posture(NAMES, joints, change, by_ambient(pad))


def test_fit_explains_postures_that_it_did_not_see(pad: Pad, taught: Taught) -> None:
    joints, change = rows(pad, 47.3, 301, seed=2)
    uneven = without_even(change, by_ambient(pad))
    predicted = [taught.model.predicted(one) for one in joints]
    left = uneven - np.array([one.field_t for one in predicted])
    assert np.sqrt((uneven**2).mean()) > 1e-5
    assert np.sqrt((left**2).mean()) < 3e-7
    deviation = np.sqrt(np.array([np.diagonal(one.covariance_t2) for one in predicted]))
    assert (np.abs(left) < 5.0 * deviation).all()
    assert not any(one.why for one in predicted)


def test_still_joint_takes_no_part(taught: Taught) -> None:
    assert len(taught.model.axes) == 2
    assert np.abs(taught.model.axes[:, NAMES.index("still")]).max() == pytest.approx(0.0, abs=1e-12)


def test_noise_alone_teaches_few_terms(pad: Pad) -> None:
    joints, change = rows(pad, 60.0, 500, replace(HAND, moment_am2=0.0))
    taught = fit_posture(NAMES, joints, change, by_ambient(pad))
    assert taught.terms <= 6
    assert taught.left_t == pytest.approx(NOISE_T, rel=0.15)


def test_posture_beyond_the_recorded_ones_widens_deviations(taught: Taught) -> None:
    middle = taught.model.middle_rad
    known = taught.model.predicted(middle)
    bent = taught.model.predicted(middle + np.array([2.0, 0.0, 0.0]))
    spread = taught.model.predicted(middle + np.array([0.0, 0.0, 0.3]))
    assert not known.why
    assert "bent further" in bent.why
    assert "joint 'still' is 0.30 rad away" in spread.why
    assert np.trace(bent.covariance_t2) > 10.0 * np.trace(known.covariance_t2)
    assert np.trace(spread.covariance_t2) > 10.0 * np.trace(known.covariance_t2)


def test_rest_of_another_day_shifts_the_field_and_widens(pad: Pad, taught: Taught) -> None:
    model = taught.model
    joints, change = rows(pad, 4.0, 80)
    rest, now = joints[20], joints[50]
    other = replace(model, rest_rad=rest)
    predicted = other.predicted(now)
    uneven = without_even(change, by_ambient(pad))
    assert predicted.field_t == pytest.approx(uneven[50] - uneven[20], abs=1e-6)
    along = predicted.field_t / np.linalg.norm(predicted.field_t)
    share = np.sqrt(along @ predicted.covariance_t2 @ along) / np.linalg.norm(predicted.field_t)
    assert share > OTHER_SCALE


def test_unknown_joints_allow_all_recorded_postures(taught: Taught) -> None:
    anywhere = taught.model.predicted(None)
    assert np.diagonal(anywhere.covariance_t2) == pytest.approx(np.diagonal(taught.model.spread_t2), rel=0.1)
    unknown = replace(taught.model, rest_unknown=True).predicted(taught.model.middle_rad)
    assert "baseline --rest" in unknown.why


def test_stored_posture_comes_back_the_same(taught: Taught) -> None:
    text = msgspec.json.encode(StoredPosture.of(taught))
    model = msgspec.json.decode(text, type=StoredPosture).model()
    at = taught.model.middle_rad + 0.1
    assert model.predicted(at).field_t.tolist() == taught.model.predicted(at).field_t.tolist()
    assert model.predicted(at).covariance_t2.tolist() == taught.model.predicted(at).covariance_t2.tolist()


@pytest.mark.parametrize("part", ["names", "middle_rad", "axes", "weight_t", "left_t2", "mean_t"])
def test_damaged_stored_posture_is_refused(taught: Taught, part: str) -> None:
    stored = msgspec.to_builtins(StoredPosture.of(taught))
    stored[part] = stored[part][:-1]
    with pytest.raises(msgspec.ValidationError, match="no recording gives such a posture"):
        msgspec.convert(stored, StoredPosture)


def test_posture_without_joints_is_stored_too(pad: Pad) -> None:
    _, change = rows(pad, 60.0, 300)
    taught = fit_posture((), np.empty((300, 0)), change, by_ambient(pad))
    model = msgspec.json.decode(msgspec.json.encode(StoredPosture.of(taught)), type=StoredPosture).model()
    assert isinstance(model, PostureModel)
    assert model.predicted(None).why == ""
    assert np.trace(model.predicted(None).covariance_t2) > 1e-10


def test_hand_that_stands_still_is_refused(pad: Pad) -> None:
    joints, change = rows(pad, 60.0, 300)
    with pytest.raises(BaselineError, match=r"no joint moved by more than 0\.01 rad meanwhile"):
        fit_posture(NAMES, np.tile(joints[:1], (300, 1)), change, by_ambient(pad))


def test_short_recording_is_refused(pad: Pad) -> None:
    joints, change = rows(pad, 4.0, 40)
    with pytest.raises(BaselineError, match="only 40 moments"):
        fit_posture(NAMES, joints, change, by_ambient(pad))


def test_track_joins_publishers_and_keeps_gaps() -> None:
    track = JointTrack()
    for number in range(100):
        track.take({"a": 0.01 * number}, number * 10_000_000)
    for number in range(50):
        track.take({"b": 2.0}, number * 20_000_000 + 3_000_000)
    track.take({"a": 99.0}, 5)  # older than the newest
    assert track.names == ("a", "b")
    at = track.at(np.array([0.505e9, 3e9]))
    assert at[0] == pytest.approx([0.505, 2.0])
    assert np.isnan(at[1]).all()
    assert track.mean(("a", "b"), 0, 980_000_000) == pytest.approx([0.49, 2.0], abs=0.01)
    assert track.mean(("a", "c"), 0, 980_000_000) is None
