"""Small faults that last: found by the mean residual where one frame's gate is blind."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.config import MagnetConfig, SceneConfig
from fmfts.pad import Pad
from fmfts.pose import SensorErrors, State, dipole_field, repeats_allowed
from fmfts.scene.tracking import tracking_model_for
from fmfts_lab.bench.field_tracker import FieldTracker, Tracked

NOISE_T = 2e-7
NOISE = np.full((4, 3), NOISE_T)
FRAME_S = 1 / 220
NOTHING = np.zeros((4, 3))


class Watched:
    """A tracker that looks for lasting faults, on a pad at rest with white noise."""

    def __init__(self, pad: Pad, ambient: str, seed: int = 1) -> None:
        rest = State.at_rest(pad)
        model = tracking_model_for(
            SceneConfig(ambient="drifting" if ambient == "drifting" else "constant"), MagnetConfig()
        )
        self._tracker = FieldTracker(pad, rest, model.tracking, 25.0, SensorErrors(NOISE))
        self._random = np.random.default_rng(seed)
        self._field = dipole_field(pad.sensors.position_m, rest.position_m, rest.axis, pad.magnet.strength_t_m3)

    def run(self, frames: int, added_t: np.ndarray = NOTHING) -> list[Tracked]:
        tracks = []
        for _ in range(frames):
            field = self._field + added_t + self._random.normal(0.0, NOISE_T, (4, 3))
            tracks.append(self._tracker.update(field, NOISE, FRAME_S, 25.0, NOTHING))
        return tracks


def on_one_axis(sensor: int, axis: int, field_t: float) -> np.ndarray:
    added = np.zeros((4, 3))
    added[sensor, axis] = field_t
    return added


@pytest.mark.parametrize("ambient", ["constant", "drifting"])
def test_healthy_noise_is_never_a_lasting_fault(pad: Pad, ambient: str) -> None:
    """5000 frames are 625 judgements at one in a million."""
    assert {track.health for track in Watched(pad, ambient).run(5000)} == {"ok"}


@pytest.mark.parametrize("sensor", range(4))
@pytest.mark.parametrize("axis", range(2))
def test_offset_below_the_frame_gate_is_named_within_half_a_second(pad: Pad, sensor: int, axis: int) -> None:
    """6 mG, three deviations: the gate at 1e-6 lets nearly all such frames through; 7 times less noise does not."""
    watched = Watched(pad, "constant")
    watched.run(110)
    tracks = watched.run(220, on_one_axis(sensor, axis, 6e-7))
    assert tracks[0].health == "ok"
    assert {track.health for track in tracks[110:]} == {"degraded"}
    assert all(track.reason.startswith(f"sensor {sensor + 1} ") for track in tracks[110:])
    assert all(not track.sensors_ok >> sensor & 1 for track in tracks[110:])


def test_sensor_is_used_again_after_its_fault(pad: Pad) -> None:
    watched = Watched(pad, "constant")
    watched.run(110)
    watched.run(220, on_one_axis(2, 0, 6e-7))
    tracks = watched.run(440)
    assert tracks[0].health == "degraded"
    assert {track.health for track in tracks[-100:]} == {"ok"}


def test_weak_field_from_elsewhere_is_disturbed_and_blames_no_sensor(pad: Pad) -> None:
    """4 mG alike at every sensor, where the scene says that the field is constant."""
    watched = Watched(pad, "constant")
    watched.run(110)
    tracks = watched.run(220, np.tile([2e-7, -2e-7, 2.5e-7], (4, 1)))
    assert {track.health for track in tracks[110:]} == {"disturbed"}


def test_drifting_scene_does_not_guess_which_vertical_axis_failed(pad: Pad) -> None:
    """With eight unknowns, an error of one sensor's z looks like that of any other's: parity has one pattern of z."""
    watched = Watched(pad, "drifting")
    watched.run(110)
    for step in range(60):  # grows by 0.5 mG a frame: the tracker learns the field from the faulty sensor all the time
        watched.run(1, on_one_axis(1, 2, 5e-8 * step))
    tracks = watched.run(220, on_one_axis(1, 2, 3e-6))
    assert {track.health for track in tracks[110:]} == {"lost"}
    assert {track.estimate for track in tracks[110:]} == {None}


def test_sudden_offset_in_drifting_scene_is_named_by_field_before_it(pad: Pad) -> None:
    for sensor in range(4):
        watched = Watched(pad, "drifting", seed=sensor)
        watched.run(110)
        tracks = watched.run(220, on_one_axis(sensor, 2, 1e-5))
        assert {track.health for track in tracks[1:]} == {"degraded"}
        assert all(track.reason.startswith(f"sensor {sensor + 1} ") for track in tracks[1:])


def test_living_axis_repeats_itself_less_often_than_allowed() -> None:
    """At ±2.5 G: 2 mG of noise and steps of 1.5 mG. A million samples have some runs of eight."""
    step_t = 1e-4 / 660
    random = np.random.default_rng(1)
    counts = np.rint(random.normal(0.0, NOISE_T, 1_000_000) / step_t)
    changes = np.flatnonzero(np.diff(counts) != 0)
    longest = int(np.diff(changes).max()) - 1
    noise = np.hypot(NOISE_T, step_t / np.sqrt(12))
    allowed = repeats_allowed(np.full((4, 3), noise), step_t)
    assert allowed.shape == (4, 3)
    # p^k = 1e-8 against p^k = 1e-6: three halves of the longest run, which itself wanders by a few.
    assert longest < allowed[0, 0] < 2.5 * longest


def test_axis_whose_noise_is_rounded_away_may_stand_still() -> None:
    step_t = 1e-4 / 230
    assert np.isinf(repeats_allowed(np.full((4, 3), step_t / np.sqrt(12)), step_t)).all()


def test_mean_residual_below_alarm_widens_deviations(pad: Pad) -> None:
    """0.9 mG of a field from elsewhere: now below and now above what 99.9999 % of sound means stay under."""

    def deviation(added_t: np.ndarray) -> float:
        watched = Watched(pad, "constant")
        watched.run(110)
        published = [track.estimate for track in watched.run(330, added_t)[110:] if track.health == "ok"]
        assert len(published) > 100
        return float(np.mean([np.sqrt(estimate.covariance[2, 2]) for estimate in published if estimate]))

    assert deviation(np.tile([5e-8, -5e-8, 6e-8], (4, 1))) > 1.1 * deviation(NOTHING)
