"""Pads with several magnets beside each other, and beside pads with one: all magnets of a neighbour are followed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig, SimulatedSource, neighbours_of
from fmfts.pad import Pad, Placement, rotation_from_vector
from fmfts.pipeline.configured import Pipeline, contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.snapshot import restore, snapshot
from fmfts.pose._alignment import REACH_M
from fmfts.pose.neighbour import NeighbourEstimate, NeighbourView, change_of
from fmfts.pose.sighting import Sighting
from fmfts.scene.neighbours import neighbours_around
from fmfts.sensor import Frame
from fmfts_lab.bench.neighbours import pair
from fmfts_lab.bench.truth import WRONG_DEVIATIONS
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.array import SimulatedArray, simulated_pad
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger
from fmfts_simulation.neighbour import SeveralMagnets
from oracle import neighbours as oracle

PERIOD_NS = round(1e9 / 220)
FRAMES = 88
PRESS, LIGHTER = steady_finger(3e-3, -2e-3, 1.2), steady_finger(-4e-3, 2e-3, 0.8)
Magnets = tuple[int, int]
ARRAYS, ARRAY_AND_ONE = (4, 4), (4, 1)


@cache
def pads(magnets: Magnets, apart_mm: float = 40.0) -> tuple[PadConfig, PadConfig]:
    return pair(apart_mm, "drifting", 1, magnets)


@cache
def baselines(magnets: Magnets) -> Mapping[str, Baseline]:
    both = pads(magnets)
    return {pad.name: simulated_baseline(pad, neighbours_of(pad, both)) for pad in both}


def pipelines_of(magnets: Magnets, told: bool = True) -> dict[str, Pipeline]:
    both, made = pads(magnets), {}
    for pad in both:
        made[pad.name] = pipeline_of(pad, contact_model_of(pad), "boot")
        made[pad.name].use(baselines(magnets)[pad.name])
    for pad in both if told else ():
        feel_neighbours(pad, both, made)
    return made


@cache
def frames_of(magnets: Magnets, first: Finger, second: Finger, count: int = FRAMES) -> dict[str, list[Frame]]:
    """Of both pads, pressed by a finger each."""
    both = pads(magnets)
    fingers = dict(zip((pad.name for pad in both), (first, second), strict=True))
    frames = {}
    for pad in both:
        source, others = simulated_pad(pad, neighbours_of(pad, both)), neighbours_of(pad, both)
        source.finger = fingers[pad.name]
        for other, beside in zip(others, source.neighbours, strict=True):
            beside.finger = fingers[other.name]
        frames[pad.name] = [frame for step in range(count) for frame in source.poll(step * PERIOD_NS)]
    return frames


def told_of(pipelines: Mapping[str, Pipeline], frames: Mapping[str, list[Frame]]) -> dict[str, list[ContactMessage]]:
    """The messages of both pads, whose frames come in turns."""
    messages: dict[str, list[ContactMessage]] = {name: [] for name in frames}
    for together in zip(*frames.values(), strict=True):
        for name, frame in zip(frames, together, strict=True):
            messages[name].append(pipelines[name].process(frame))
    return messages


def pressed(magnets: Magnets, first: Finger, second: Finger, told: bool = True) -> dict[str, list[ContactMessage]]:
    return told_of(pipelines_of(magnets, told), frames_of(magnets, first, second))


def deviations(message: ContactMessage, truth: Touch) -> float:
    """The largest error of place and force, in published deviations."""
    pairs = (
        (message.x_m, message.x_sd_m, truth.x_m),
        (message.y_m, message.y_sd_m, truth.y_m),
        (message.force_n, message.force_sd_n, truth.force_n),
    )
    return max(abs(value - true) / sd for value, sd, true in pairs if value is not None and sd is not None)


def is_untouched(messages: list[ContactMessage]) -> bool:
    return all(message.health == "ok" and message.contact is False for message in messages)


# A pad with one magnet may not know in its first frames whether it is touched.
SETTLED = 10


def test_press_on_an_unnamed_neighbour_disturbs_an_array() -> None:
    untold = pressed(ARRAYS, no_finger, PRESS, told=False)["first"]
    assert sum(message.health == "disturbed" for message in untold) > FRAMES / 2
    told = pressed(ARRAYS, no_finger, PRESS)
    assert is_untouched(told["first"])
    assert all(message.health == "ok" and message.contact for message in told["second"][1:])


@pytest.mark.parametrize("magnets", [ARRAYS, ARRAY_AND_ONE], ids=["two arrays", "an array and one magnet"])
def test_two_pads_that_are_both_pressed_are_both_right(magnets: Magnets) -> None:
    messages = pressed(magnets, PRESS, LIGHTER)
    for name, finger in (("first", PRESS), ("second", LIGHTER)):
        for message in messages[name][SETTLED:]:
            assert message.health == "ok"
            assert message.contact is True
            assert deviations(message, finger(0.0)) < WRONG_DEVIATIONS


def test_single_magnet_and_array_ignore_each_others_presses() -> None:
    of_array, of_one = pressed(ARRAY_AND_ONE, PRESS, no_finger), pressed(ARRAY_AND_ONE, no_finger, PRESS)
    assert is_untouched(of_array["second"][SETTLED:])
    assert is_untouched(of_one["first"])


@pytest.mark.parametrize("magnets", [ARRAYS, ARRAY_AND_ONE], ids=["an array", "one magnet"])
def test_lost_neighbour_widens_deviations_without_wrong_answers(magnets: Magnets) -> None:
    """As beside a pad with one magnet: its magnets may be anywhere in their reach, pressed or not."""
    frames = frames_of(magnets, no_finger, PRESS)
    watched, deaf = pipelines_of(magnets), pipelines_of(magnets)
    seen = told_of(watched, frames)["first"]
    deaf["second"].process(frames["second"][0])
    unseen = [deaf["first"].process(frame) for frame in frames["first"]]
    assert is_untouched(unseen[SETTLED:])
    (view,) = deaf["first"]._neighbours  # type: ignore[union-attr]
    known, vague = (
        np.sqrt(np.diagonal(one.at(frames["first"][-1].host_time_ns).covariance)[:3])
        for one in (*watched["first"]._neighbours, view)  # type: ignore[union-attr]
    )
    assert (known < 0.3 * REACH_M).all()
    assert (vague >= REACH_M).all()
    assert is_untouched(seen)


def test_the_magnets_that_a_finger_drags_are_seen_where_they_are() -> None:
    """The table of presses without shear puts them elsewhere: the residual tells."""

    def dragged(time_s: float) -> Touch:
        return Touch(2e-3, 1e-3, 1.0, 0.25, -0.15)

    pipelines, both = pipelines_of(ARRAYS), pads(ARRAYS)
    told_of(pipelines, frames_of(ARRAYS, dragged, no_finger))
    source, sighting = simulated_pad(both[0]), pipelines["first"].be_felt()
    assert isinstance(source, SimulatedArray)
    inside = source.inside
    change = np.zeros((4, 5))
    for number, (x, y) in enumerate(inside.off_mm.tolist()):
        own = inside.response.pressed(2.0 - x, 1.0 - y, 1.0)
        change[number] = (own.change + own.by_shear @ [0.25, -0.15]).reshape(4, 5)[number] * [1e-3, 1e-3, 1e-3, 1, 1]
    deviation = np.sqrt(np.diagonal(sighting.covariance)).reshape(4, 6)[:, :3]
    for number, (last, rest) in enumerate(zip(sighting.last, sighting.rest, strict=True)):
        off = last.position_m - rest.position_m - change[number, :3]
        assert (np.abs(off) < 5.0 * deviation[number]).all()
        assert np.abs(off[:2]).max() < 3e-6  # shear moves them sideways by 1e-5
    assert deviation.max() < 3e-5


def at(pad: Pad) -> NeighbourEstimate:
    turned = Placement(np.array([0.04, 0.005, 0.0]), rotation_from_vector(np.array([0.2, -0.3, 0.5])), 0.0)
    return NeighbourView(Sighting.unseen(pad), turned).at(0)


def test_neighbours_field_is_as_uncertain_as_its_magnets() -> None:
    pad, random = array_config().pad(), np.random.default_rng(3)
    seen = at(pad)
    moved = oracle.stepped(seen.rest, np.tile([1e-4, -2e-4, -3e-4, 0.02, 0.01, 0.0], 4))
    root = 1e-4 * random.standard_normal((24, 24)) * np.tile([1.0, 1.0, 1.0, 50.0, 50.0, 10.0], 4)[:, None]
    seen = NeighbourEstimate(seen.magnets, seen.rest, moved, root @ root.T, 0.0, np.zeros((4, 2)))
    change, covariance = change_of(pad.sensors, [seen])

    def after(step: np.ndarray) -> np.ndarray:
        field_t = oracle.fields(seen.magnets, oracle.stepped(moved, step), pad.sensors).sum(axis=0)
        return np.asarray(field_t.ravel())

    rest_t = oracle.fields(seen.magnets, seen.rest, pad.sensors).sum(axis=0)
    np.testing.assert_allclose(change.ravel(), after(np.zeros(24)) - rest_t.ravel(), atol=1e-15)
    effects = np.column_stack([(after(1e-3 * each) - after(-1e-3 * each)) / 2e-3 for each in root.T])
    np.testing.assert_allclose(covariance, effects @ effects.T, rtol=1e-3, atol=1e-5 * np.abs(covariance).max())


def test_baseline_uncertainty_counts_in_the_change() -> None:
    pad = array_config().pad()
    seen = at(pad)
    moved = oracle.stepped(seen.rest, np.tile([0.0, 0.0, -4e-4, 0.0, 0.0, 0.0], 4))

    def variance(rest_error: np.ndarray) -> np.ndarray:
        known = NeighbourEstimate(seen.magnets, seen.rest, moved, np.zeros((24, 24)), 0.0, rest_error)
        return np.diagonal(change_of(pad.sensors, [known])[1])

    np.testing.assert_allclose(variance(np.zeros((4, 2))), 0.0, atol=1e-30)
    assert (variance(np.tile([0.0, 0.1], (4, 1))) > 0.0).all()
    assert (variance(np.tile([1e-4, 0.0], (4, 1))) > 0.0).all()


def test_snapshot_of_neighbours_continues_bit_identically() -> None:
    frames = frames_of(ARRAYS, PRESS, LIGHTER)
    before, after = ({name: each[part] for name, each in frames.items()} for part in (slice(44), slice(44, None)))
    first, second = pipelines_of(ARRAYS), pipelines_of(ARRAYS)
    told_of(first, before)
    for name, pipeline in first.items():
        restore(second[name], snapshot(pipeline))
    went_on, repeated = told_of(first, after), told_of(second, after)
    for name in frames:
        for one, other in zip(went_on[name], repeated[name], strict=True):
            assert (one.contacts, one.force_n, one.force_sd_n, one.poses, one.health) == (
                other.contacts,
                other.force_n,
                other.force_sd_n,
                other.poses,
                other.health,
            )


def test_simulated_pad_measures_its_neighbours_magnets() -> None:
    one, other = pads(ARRAY_AND_ONE)
    assert isinstance(other.source, SimulatedSource)
    source, beside = simulated_pad(other, [one]), simulated_pad(one)
    assert isinstance(beside, SimulatedArray)
    (felt,) = source.neighbours
    assert isinstance(felt, SeveralMagnets)
    felt.finger, felt.second_finger = PRESS, LIGHTER
    here = np.array([[0.0, 0.0, 0.0], [5e-3, -8e-3, 1e-3]])
    there = (here - felt.placement.position_m) @ felt.placement.rotation
    expected = beside.inside.field(there, [PRESS(0.0), LIGHTER(0.0)], 1.0) @ felt.placement.rotation.T
    np.testing.assert_allclose(felt.field(here, np.zeros(2), 0.0), expected, rtol=1e-12)
    moved = np.abs(expected - beside.inside.field(there, [], 1.0) @ felt.placement.rotation.T)
    assert moved.max() > 1e-7


def test_far_array_is_ignored() -> None:
    for apart_mm, is_felt in ((100.0, True), (200.0, False)):
        first, second = pads(ARRAYS, apart_mm)
        (neighbour,) = neighbours_around(first, (first, second))
        assert neighbour.is_felt is is_felt
        assert neighbour.magnets == 4
        assert neighbour.distance_m == pytest.approx((apart_mm - 12.0) * 1e-3, rel=0.01)
