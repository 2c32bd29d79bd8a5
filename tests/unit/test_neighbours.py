"""The magnets of other pads: where they are seen, what they do to a pose, and two pressed pads side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pose_steps_in_c import SingleSteps

from fmfts.baseline import Mounting
from fmfts.config import PadConfig, PlacementConfig, SimulatedSource
from fmfts.contact.no_model import no_model_for
from fmfts.pad import Pad, Placement, rotation_from_vector
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pose import PAPER, SIZE, State, dipole_field
from fmfts.pose._alignment import MOMENT_DEVIATION, REACH_M, REACH_RAD
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.sighting import Sighting, values_of
from fmfts.scene.neighbours import neighbours_around
from fmfts.sensor import Frame
from fmfts_lab.bench.neighbours import pair, pressed_pair
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.source import Simulated
from oracle import neighbours as oracle

NOISE_T = 2e-7
STEP_SD = np.array([3e-5, 3e-5, 3e-5, 5e-3, 5e-3, MOMENT_DEVIATION])
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def placement(position: np.ndarray, turn: np.ndarray) -> Placement:
    return Placement(0.03 * position, rotation_from_vector(3.0 * turn), 0.0)


def view(pad: Pad, *, position_m: tuple[float, float, float] = (0.025, 0.0, 0.0)) -> NeighbourView:
    turn = rotation_from_vector(np.array([0.3, -0.2, 0.5]))
    return NeighbourView(Sighting.unseen(pad), Placement(np.array(position_m), turn, 0.0))


@given(vectors, vectors, vectors, vectors, vectors)
def test_neighbour_has_the_field_that_the_common_frame_gives_it(
    here: np.ndarray, here_turn: np.ndarray, there: np.ndarray, there_turn: np.ndarray, step: np.ndarray
) -> None:
    pad = PadConfig(name="one", source=SimulatedSource()).pad()
    own, others = placement(here, here_turn), placement(there + np.array([0.0, 0.0, 3.0]), there_turn)
    moved = State.at_rest(pad).stepped(np.append(1e-3 * step, [0.1 * step[0], 0.1 * step[1]]))
    sighting = Sighting((pad.magnet,), (State.at_rest(pad),), (moved,), np.diag(STEP_SD**2), np.zeros((1, 2)), 0)
    seen = NeighbourView(sighting, others.seen_from(own)).at(0)
    places = np.array([own.point(place) for place in pad.sensors.position_m])
    magnet = pad.magnet.strength_t_m3, pad.magnet.octupole_m2
    common = dipole_field(places, others.point(moved.position_m), others.rotation @ moved.axis, *magnet)
    rest_t, change_t, _ = seen.effect(pad.sensors)
    np.testing.assert_allclose(rest_t + change_t, common @ own.rotation, rtol=1e-9, atol=1e-15)


def test_neighbour_is_less_certain_the_longer_it_was_not_seen(pad: Pad) -> None:
    neighbour = view(pad)
    deviation = {}
    for age_ns in (0, 5_000_000, 10_000_000, 10_000_000_000):
        neighbour.sighting.time_ns = 0
        deviation[age_ns] = np.sqrt(np.diagonal(neighbour.at(age_ns).covariance))
    assert (np.diff(list(deviation.values()), axis=0)[:, :5] > 0.0).all()
    np.testing.assert_allclose(deviation[10_000_000_000][:5], [REACH_M] * 3 + [REACH_RAD] * 2)
    neighbour.sighting.time_ns = None
    np.testing.assert_allclose(np.sqrt(np.diagonal(neighbour.at(0).covariance)), deviation[10_000_000_000])


@pytest.mark.parametrize("magnets", [(1,), (4,), (2, 1, 1)], ids=str)
def test_neighbours_agree_with_the_oracle(
    pad: Pad, magnets: tuple[int, ...], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """For a pad with one magnet, which solves them, and for one with several, which considers them."""
    steps, random = SingleSteps(tmp_path_factory.mktemp("felt")), np.random.default_rng(sum(magnets))
    mounted = replace(pad, sensors=replace(pad.sensors, axes=pad.sensors.axes + 0.02 * random.normal(size=(4, 3, 3))))
    time_ns = 9_000_000
    for seen_ns in (None, 0, 7_000_000, 4_000_000_000):
        views = [drawn_view(pad, count, seen_ns, random) for count in magnets]
        felt, seen = steps.felt(mounted, views, time_ns), [each.at(time_ns) for each in views]
        age_s = np.inf if seen_ns is None else 1e-9 * abs(time_ns - seen_ns)
        covariances = [oracle.covariance(each.sighting, each.placement, age_s) for each in views]
        fields = []
        for each, own, covariance in zip(views, seen, covariances, strict=True):
            rest, now = (
                oracle.placed(values_of(where), each.placement) for where in (each.sighting.rest, each.sighting.last)
            )
            np.testing.assert_allclose(own.rest, rest, rtol=1e-12, atol=1e-15)
            np.testing.assert_allclose(own.now, now, rtol=1e-12, atol=1e-15)
            near(own.covariance, covariance)
            fields.append(oracle.fields(own.magnets, rest, mounted.sensors).sum(axis=0))
            np.testing.assert_allclose(own.effect(mounted.sensors)[0], fields[-1], rtol=1e-9, atol=1e-17)
        np.testing.assert_array_equal(felt.rest, np.concatenate([each.rest for each in seen]))
        np.testing.assert_array_equal(felt.now, np.concatenate([each.now for each in seen]))
        near(felt.covariance, oracle.together(covariances))
        np.testing.assert_allclose(felt.added_t, sum(fields), rtol=1e-9, atol=1e-17)
        variance = sum(oracle.variance(each.sighting, each.placement, mounted.sensors) for each in views)
        np.testing.assert_allclose(felt.added_t2, np.tile(variance, (3, 1)).T, rtol=1e-9)


def near(told: np.ndarray, wanted: np.ndarray) -> None:
    """Within what differences leave of each pair of deviations."""
    deviation = np.sqrt(np.diagonal(wanted))
    assert (np.abs(told - wanted) < 1e-6 * np.outer(deviation, deviation)).all()


def drawn_view(pad: Pad, magnets: int, seen_ns: int | None, random: np.random.Generator) -> NeighbourView:
    """The view of a pad with this many magnets, anywhere in their reach."""
    where = [
        tuple(State.at_rest(pad).stepped(np.append(STEP_SD[:5], 0.01) * random.normal(size=6)) for _ in range(magnets))
        for _ in range(2)
    ]
    root = STEP_SD.repeat(magnets)[:, None] * random.normal(size=(6 * magnets, 6 * magnets))
    rest_error = random.uniform(0.0, 1.0, (magnets, 2)) * [1e-4, 0.01]
    sighting = Sighting((pad.magnet,) * magnets, *where, root @ root.T, rest_error, seen_ns)
    turn = rotation_from_vector(random.normal(size=3))
    return NeighbourView(sighting, Placement(np.array([0.03, 0.0, 0.0]) + 0.01 * random.normal(size=3), turn, 2e-4))


def certain(mounting: Mounting) -> Mounting:
    """A baseline that leaves nothing unknown but the noise of a frame."""
    nothing = np.zeros_like
    return replace(
        mounting,
        noise_t=np.full_like(mounting.noise_t, NOISE_T),
        sensitivity_deviation=nothing(mounting.sensitivity_deviation),
        place_deviation=nothing(mounting.place_deviation),
        systematic_t=0.0,
    )


def measured(frame: Frame, mounting: Mounting, field_t: np.ndarray) -> Frame:
    """A frame in which all chips have just measured that, which is what a baseline leaves."""
    step_t = frame.chip.step_t[frame.gain_code]
    counts = np.round((field_t + mounting.offset_t) * mounting.gain / step_t).astype(np.int16)
    return replace(frame, counts=counts, age_us=np.zeros(len(counts), np.uint16))


def test_pose_beside_an_uncertain_neighbour_scatters_as_stated() -> None:
    """NEES of five unknowns over 300 frames: 5 ± 4·√(10/300)."""
    config = PadConfig(name="one", source=SimulatedSource())
    drawing, baseline = config.pad(), simulated_baseline(config)
    pipeline = PadPipeline(drawing, no_model_for("none"), "boot", 220.0, PAPER)
    mounting = pipeline.use(baseline, certain(baseline.mounting(drawing)))
    pad, rest = mounting.mounted(drawing), mounting.rest
    neighbour, random, nees = view(drawing, position_m=(0.02, 0.0, 0.0)), np.random.default_rng(1), []
    pipeline.feel(neighbour.sighting, neighbour.placement)
    strength, octupole_m2 = pad.magnet.strength_t_m3 * np.exp(rest.log_moment), pad.magnet.modelled_octupole_m2
    own = pad.sensors.to_sensor(
        dipole_field(pad.sensors.position_m, rest.position_m, rest.axis, strength, octupole_m2) + rest.ambient_t
    )
    frame = Simulated(config).poll(10**9)[-1]
    sighting, last = neighbour.sighting, State.at_rest(drawing).stepped(np.array([1e-4, 0.0, -3e-4, 0.05, 0.0]))
    sighting.last = (last,)
    sighting.covariance = np.diag(STEP_SD**2 - np.eye(6)[5] * MOMENT_DEVIATION**2)
    sighting.time_ns = frame.host_time_ns
    seen, untouched = neighbour.at(frame.host_time_ns), pipeline.memory
    for _ in range(300):
        truth = oracle.placed(values_of([last.stepped(STEP_SD * random.standard_normal(6))]), neighbour.placement)
        # Errors that a baseline leaves: this magnet, and the neighbour's changes since.
        change = replace(seen, now=truth).effect(pad.sensors)[1]
        pipeline.recall(untouched)
        message = pipeline.process(measured(frame, mounting, own + change + random.normal(0.0, NOISE_T, (4, 3))))
        assert message.health == "ok", message.reason
        memory = pipeline.memory.fields
        found, covariance = State.from_vector(memory["state"]), memory["covariance"].reshape(SIZE, SIZE)[:5, :5]
        error = found.step_from(rest)[:5]
        nees.append(float(error @ np.linalg.solve(covariance, error)))
    assert abs(np.mean(nees) - 5.0) < 4.0 * np.sqrt(10.0 / 300.0)


@pytest.mark.long
def test_two_pressed_neighbours_30_mm_apart_stay_right() -> None:
    """The worst of 4,000 errors of healthy pads is below four deviations; five is wrong."""
    pads = pair(30.0, "drifting", seed=1)
    told, untold = pressed_pair(pads, told=True, seconds=5.0), pressed_pair(pads, told=False, seconds=5.0)
    assert told.health == {"ok": told.frames}
    assert told.wrong == told.false_contacts == 0
    assert len(told.errors) > 500
    assert untold.health["ok"] < 0.9 * untold.frames
    # A neighbour that the configuration does not name is a foreign magnet: flagged, or counted in the deviations
    # (hidden_gradient.py).
    assert untold.wrong == untold.false_contacts == 0


def test_far_neighbour_is_ignored() -> None:
    for distance_mm, felt in ((60.0, True), (120.0, False)):
        first, second = pair(distance_mm, "drifting", seed=1)
        (neighbour,) = neighbours_around(first, (first, second))
        assert neighbour.is_felt is felt
        assert neighbour.name == "second"
        assert neighbour.distance_m == pytest.approx(distance_mm * 1e-3, rel=0.01)
        assert ("left out" in neighbour.why) is not felt


def test_placement_is_in_si_and_relative() -> None:
    one = PlacementConfig(position_mm=(10, 0, 0), rotation_deg=(0, 0, 90), tolerance_mm=0.3).si()
    other = PlacementConfig(position_mm=(10, 25, 0), tolerance_mm=0.4).si()
    seen = other.seen_from(one)
    np.testing.assert_allclose(seen.position_m, [0.025, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(seen.rotation @ [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], atol=1e-15)
    assert seen.tolerance_m == pytest.approx(0.5e-3)
