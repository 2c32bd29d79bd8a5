"""The joints of a hand as they arrive: what is known of the field at a frame's time, in Python and in C's table."""

from __future__ import annotations

import numpy as np
import pytest

from emulator.hand_magnets import NAMES, HandMagnets
from fmfts.baseline.posture_fit import fit_posture
from fmfts.pad import Pad
from fmfts.pose._alignment import SILENT_S
from fmfts.pose.hand import SPARES_NS, Hand
from fmfts.pose.posture import PostureModel
from fmfts.sensor.joints import Joints
from unit.test_posture_fit import by_ambient, rows

UNTAUGHT = "the field of the hand's posture was not taught: `fmfts-daemon baseline --posture`"
NONE_CAME = "no joint positions have arrived: docs/scene.md says how to publish them"
HAND = HandMagnets(period_s=4.0)
PERIOD_NS = 20_000_000


@pytest.fixture(scope="module")
def model() -> PostureModel:
    from fmfts.config import PadConfig, SimulatedSource

    pad: Pad = PadConfig(name="left", source=SimulatedSource()).pad()
    joints, change = rows(pad, 60.0, 400)
    return fit_posture(NAMES, joints, change, by_ambient(pad)).model


def moved(hand: Hand, seconds: float) -> int:
    """Positions up to this time; returns the time of the last ones."""
    last = 0
    for time_ns in range(PERIOD_NS, int(seconds * 1e9), PERIOD_NS):
        hand.take(HAND.joints_rad(time_ns * 1e-9), time_ns)
        last = time_ns
    return last


def true_field(model: PostureModel, time_ns: int) -> np.ndarray:
    joints = HAND.joints_rad(time_ns * 1e-9)
    return model.predicted(np.array([joints[name] for name in NAMES])).field_t


def test_missing_posture_or_joints_are_reported(model: PostureModel) -> None:
    hand = Hand(12)
    assert hand.at(0).why == UNTAUGHT
    hand.use(model)
    assert hand.at(0).why == NONE_CAME
    assert np.trace(hand.at(0).covariance_t2) > 1e-10


@pytest.mark.parametrize("later_ns", [-PERIOD_NS, -10_000_000, 0, 15_000_000, 40_000_000])
def test_field_is_followed_between_and_beyond_positions(model: PostureModel, later_ns: int) -> None:
    hand = Hand(12)
    hand.use(model)
    last_ns = moved(hand, 1.3)
    predicted = hand.at(last_ns + later_ns)
    error = predicted.field_t - true_field(model, last_ns + later_ns)
    assert predicted.why == ""
    assert np.abs(error).max() < 1e-6
    assert (np.abs(error) < 4.0 * np.sqrt(np.diagonal(predicted.covariance_t2))).all()


def test_deviation_grows_with_time_and_speed(model: PostureModel) -> None:
    hand = Hand(12)
    hand.use(model)
    last_ns = moved(hand, 1.3)
    traces = [np.trace(hand.at(last_ns + later_ns).covariance_t2) for later_ns in (0, 50_000_000, 200_000_000)]
    assert traces[0] < traces[1] < traces[2]


def test_joints_that_stop_arriving_are_wide_and_named(model: PostureModel) -> None:
    hand = Hand(12)
    hand.use(model)
    last_ns = moved(hand, 1.3)
    silent = hand.at(last_ns + int((SILENT_S + 0.08) * 1e9))
    assert silent.why == "joint positions stopped arriving 0.3 s ago: start the program that publishes them"
    assert np.trace(silent.covariance_t2) > 5.0 * np.trace(hand.at(last_ns).covariance_t2)
    ahead = hand.at(last_ns - 2_000_000_000).why
    assert (
        ahead == "joint positions are stamped 2.0 s ahead of the frames: stamp them by this computer's monotonic clock"
    )


def test_one_silent_joint_makes_the_posture_unknown(model: PostureModel) -> None:
    hand = Hand(12)
    hand.use(model)
    last_ns = moved(hand, 1.3)
    for number in range(1, 40):
        hand.take({"knuckle": 1.5}, last_ns + number * PERIOD_NS)
    assert "stopped arriving" in hand.at(last_ns + 40 * PERIOD_NS).why


def test_joint_that_is_stamped_by_another_clock_is_not_known(model: PostureModel) -> None:
    hand = Hand(12)
    hand.use(model)
    hand.take({"middle": 0.3}, 1_700_000_000_000_000_000)
    for number in range(1, 40):
        hand.take({"knuckle": 1.5, "still": 0.0}, number * PERIOD_NS)
    assert hand.at(40 * PERIOD_NS).why == NONE_CAME


def test_joints_may_come_from_several_programs(model: PostureModel) -> None:
    hand = Hand(12)
    hand.use(model)
    for number in range(1, 20):
        time_ns = number * PERIOD_NS
        joints = HAND.joints_rad(time_ns * 1e-9)
        hand.take({"knuckle": joints["knuckle"], "elbow": 3.0}, time_ns)
        hand.take({"middle": joints["middle"], "still": joints["still"]}, time_ns + 1_000_000)
    assert hand.at(time_ns).why == ""


def test_positions_that_come_too_fast_are_left_out(model: PostureModel) -> None:
    hand = Hand(12)
    hand.use(model)
    hand.take(HAND.joints_rad(0.0), PERIOD_NS)
    hand.take(HAND.joints_rad(0.1), PERIOD_NS + SPARES_NS - 1)
    assert hand.joints.time_ns == PERIOD_NS
    hand.take(HAND.joints_rad(0.1), PERIOD_NS + SPARES_NS)
    assert hand.joints.time_ns == PERIOD_NS + SPARES_NS


def test_clock_that_begins_anew_is_followed(model: PostureModel) -> None:
    hand = Hand(12)
    hand.use(model)
    hand.take(HAND.joints_rad(0.0), 10**12)
    hand.take(HAND.joints_rad(0.0), 10**9)
    assert hand.joints == Joints(10**9, tuple(HAND.joints_rad(0.0)[name] for name in NAMES))


def test_recalled_joints_give_the_same_field(model: PostureModel) -> None:
    hand, other = Hand(12), Hand(12)
    hand.use(model)
    other.use(model)
    last_ns = moved(hand, 1.3)
    other.recall(hand.joints)
    later_ns = last_ns + 7_000_000
    assert other.at(later_ns).field_t.tolist() == hand.at(later_ns).field_t.tolist()
    with pytest.raises(ValueError, match="1 joints, and 3 were taught"):
        other.recall(Joints(5, (1.0,)))
