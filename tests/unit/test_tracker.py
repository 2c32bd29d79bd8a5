"""The verdict of the tracker on single fields: pose/tracker.c, gate.c and fault_search.c."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmfts.pad import Pad
from fmfts.pose import State, TrackingModel, dipole_field, parts_of
from fmfts.pose.field_errors import SensorErrors
from fmfts_lab.bench.field_tracker import FieldTracker

NOISE_T = 2e-7
SEARCH_EVERY = 8  # fault_search.c: frames of a disturbance in which it searches a cause
DEVIATION = np.full((4, 3), NOISE_T)
CONSTANT = TrackingModel(parts_of(free=np.arange(6)))


def field_at(pad: Pad, state: State) -> np.ndarray:
    strength = pad.magnet.strength_t_m3 * np.exp(state.log_moment)
    return dipole_field(pad.sensors.position_m, state.position_m, state.axis, strength)


@pytest.fixture
def rest(pad: Pad) -> State:
    return State.at_rest(pad)


@pytest.fixture
def pressed(rest: State) -> State:
    """About what 1 N beside the centre does."""
    return rest.stepped(np.array([2e-4, 1e-4, -8e-4, 0.05, 0.02, 0.0, 0, 0, 0]))


@pytest.fixture
def tracker(pad: Pad, rest: State) -> FieldTracker:
    return FieldTracker(pad, rest, CONSTANT)


def test_healthy_noise_is_never_an_alarm(pad: Pad, tracker: FieldTracker, pressed: State) -> None:
    random = np.random.default_rng(1)
    field = field_at(pad, pressed)
    # 2000 frames at a gate that passes all but one in a million.
    for _ in range(2000):
        track = tracker.update(field + random.normal(0.0, NOISE_T, (4, 3)), DEVIATION)
        assert track.health == "ok"


def test_saturated_axis_is_dropped_and_flagged(pad: Pad, tracker: FieldTracker, pressed: State) -> None:
    field = field_at(pad, pressed)
    field[1, 2] = np.nan
    track = tracker.update(field, DEVIATION)
    assert track.health == "degraded"
    assert "sensor 2" in track.reason
    assert track.estimate is not None
    assert track.estimate.position_m == pytest.approx(pressed.position_m, abs=1e-6)
    assert track.sensors_ok == 0b1101


@pytest.mark.parametrize("sensor", range(4))
def test_contradicting_sensor_is_named_and_left_out(pad: Pad, rest: State, pressed: State, sensor: int) -> None:
    tracker, random = FieldTracker(pad, rest, CONSTANT), np.random.default_rng(sensor)
    field = field_at(pad, pressed)
    field[sensor, sensor % 3] += 1e-5  # 100 mG
    for _ in range(20):
        track = tracker.update(field + random.normal(0.0, NOISE_T, (4, 3)), DEVIATION)
        assert track.health == "degraded"
        assert f"sensor {sensor + 1} contradicts" in track.reason
        assert track.estimate is not None
        # Three sensors: 12 µm at worst (see docs); five of those.
        assert track.estimate.position_m == pytest.approx(pressed.position_m, abs=6e-5)


def test_contradicting_sensor_near_steel_is_disturbed(pad: Pad, rest: State, pressed: State) -> None:
    """A tool that passes makes one sensor contradict the others, too, and without it a force of 4 N."""
    tracker = FieldTracker(pad, rest, replace(CONSTANT, steel_nearby=True))
    field = field_at(pad, pressed)
    field[2, 1] += 1e-5
    track = tracker.update(field, DEVIATION)
    assert (track.health, track.estimate) == ("disturbed", None)
    assert track.reason.startswith("sensor 3 contradicts the others")
    assert "steel or a magnet is near" in track.reason
    field[2] = np.nan  # a sensor that does not answer is excluded there, too
    assert tracker.update(field, DEVIATION).health == "degraded"


def test_turned_robot_is_disturbed_not_a_contact(pad: Pad, tracker: FieldTracker, rest: State) -> None:
    """Half a gauss from nowhere: no sensor is to blame, and no pose explains it."""
    track = tracker.update(field_at(pad, rest) + np.array([3e-5, -3e-5, 2e-5]), DEVIATION)
    assert track.health in ("disturbed", "lost")
    assert "not come from this magnet alone" in track.reason


def test_cause_belongs_to_the_present_disturbance(pad: Pad, rest: State) -> None:
    """After a frame that fits a stronger magnet, which needs no search, and a disturbance of another cause before."""
    tracker = FieldTracker(pad, rest, CONSTANT, errors=SensorErrors(DEVIATION, None))
    stronger = rest.stepped(np.array([0, 0, 0, 0, 0, 0.2, 0, 0, 0]))
    two_sensors = field_at(pad, rest)
    two_sensors[0, 0] += 3e-5
    two_sensors[3, 2] -= 3e-5
    for before in (None, np.full((4, 3), 1e-3)):
        if before is not None:
            assert "no pose of this magnet" in tracker.update(before, DEVIATION).reason
            assert tracker.update(field_at(pad, rest), DEVIATION).health == "ok"
        assert "stronger" in tracker.update(field_at(pad, stronger), DEVIATION).reason
        assert "does not come from this magnet alone" in tracker.update(two_sensors, DEVIATION).reason
        assert tracker.update(field_at(pad, rest), DEVIATION).health == "ok"


def test_vanished_magnet_is_lost_and_found_again(pad: Pad, tracker: FieldTracker, pressed: State) -> None:
    field = field_at(pad, pressed)
    assert tracker.update(field, DEVIATION).health == "ok"
    random = np.random.default_rng(2)
    lost = tracker.update(random.normal(0.0, NOISE_T, (4, 3)), DEVIATION)
    assert lost.health == "lost"
    assert lost.estimate is None
    found = tracker.update(field, DEVIATION)
    assert found.health == "ok"
    assert found.estimate is not None
    assert found.estimate.position_m == pytest.approx(pressed.position_m, abs=1e-6)


def test_failed_start_is_replaced_by_rest(pad: Pad, tracker: FieldTracker, rest: State) -> None:
    """A magnet that was seen upside down, then steel, then the pad as it should be: no search from there leads back."""
    fallen = replace(
        rest,
        position_m=np.array([1.14964e-3, 1.80606e-3, 8.66247e-3]),
        axis=np.array([0.65950428, -0.08882453, -0.7464344]) / np.linalg.norm([0.65950428, -0.08882453, -0.7464344]),
    )
    tracker.memory.put("state", fallen.vector())
    assert tracker.update(field_at(pad, fallen), DEVIATION).health == "ok"
    steel = np.random.default_rng(5).normal(0.0, 1e-4, (4, 3))
    assert tracker.update(field_at(pad, fallen) + steel, DEVIATION).estimate is None
    back = rest.stepped(np.array([-9.2e-4, -6.1e-4, 8.9e-4, -0.2, 0.2, 0, 0, 0, 0]))
    health = [tracker.update(field_at(pad, back), DEVIATION).health for _ in range(2 * SEARCH_EVERY)]
    assert health[0] != "ok"  # otherwise the tracker finds nothing from this pose
    assert health[SEARCH_EVERY:] == ["ok"] * SEARCH_EVERY


def test_disturbed_frame_publishes_no_pose(pad: Pad, tracker: FieldTracker, rest: State) -> None:
    """Its χ² has failed, so its covariance says nothing: a robot that has turned in 60 mG."""
    for _ in range(2 * SEARCH_EVERY):
        track = tracker.update(field_at(pad, rest) + np.array([3e-6, -3e-6, 4e-6]), DEVIATION)
        assert track.health == "disturbed"
        assert track.estimate is None


def test_two_sensors_are_too_few(pad: Pad, tracker: FieldTracker, pressed: State) -> None:
    field = field_at(pad, pressed)
    field[0] = np.nan
    field[3, 0] = np.nan
    track = tracker.update(field, DEVIATION)
    assert track.health == "lost"
    assert track.estimate is None
    assert track.reason.startswith("sensor 1 is without a new sample; sensor 4 is without")


def test_jump_across_the_pad_is_followed_within_one_frame(pad: Pad, tracker: FieldTracker, rest: State) -> None:
    far = rest.stepped(np.array([1e-3, -1e-3, -2e-3, 0.5, -0.4, 0.0, 0, 0, 0]))
    tracker.update(field_at(pad, rest), DEVIATION)
    track = tracker.update(field_at(pad, far), DEVIATION)
    assert track.health == "ok"
    assert track.estimate is not None
    assert track.estimate.position_m == pytest.approx(far.position_m, abs=1e-6)


def test_misfit_below_the_gate_widens_the_answer(pad: Pad, rest: State) -> None:
    """Noise twice as large as its deviations say: χ² is four times its degrees of freedom, deviations are to double."""
    field, random = field_at(pad, rest), np.random.default_rng(4)
    deviations = {}
    for share in (1.0, 2.0):
        tracker, seen = FieldTracker(pad, rest, CONSTANT), []
        for _ in range(400):
            track = tracker.update(field + random.normal(0.0, share * NOISE_T, (4, 3)), DEVIATION)
            if track.health == "ok":
                assert track.estimate is not None
                seen.append(np.sqrt(track.estimate.covariance[2, 2]))
        deviations[share] = float(np.mean(seen))
    exact = 6.1e-6  # deviation of z with six unknowns at rest: docs/pose.md's bound
    assert 1.0 < deviations[1.0] / exact < 1.1
    # Frames above the gate are not published, which removes the largest misfits.
    assert 1.6 < deviations[2.0] / exact < 2.1


def test_place_with_a_millimetre_of_deviation_is_lost(pad: Pad, tracker: FieldTracker, pressed: State) -> None:
    field = field_at(pad, pressed)
    assert tracker.update(field, np.full((4, 3), 2e-6)).health == "ok"
    track = tracker.update(field, np.full((4, 3), 2.5e-5))
    assert track.health == "lost"
    assert track.estimate is None
