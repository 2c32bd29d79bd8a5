"""`baseline --learn`: the geometry of a pad of which only a sketch is known, from presses that nobody labelled."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from mounted_world import World
from rough_world import SKETCH, bare_and_rest, fields, presses, rough_world

from fmfts.baseline import Baseline, BaselineError, Mounting, encode, load, make_refined
from fmfts.pad import Magnet, Pad, SensorArray
from fmfts.pose.change import pad_turn_of
from fmfts_calibrate.learn.drawing import FIRST_PLACE, Drawing
from fmfts_calibrate.learn.fit import Bundle, Fields
from fmfts_calibrate.learn.make import make_learned, spread_out
from fmfts_calibrate.learn.next_press import TIMES, next_press
from fmfts_calibrate.learn.search import Learned, LearnError, learn, octupole_factor, with_octupole
from fmfts_calibrate.learn.uniqueness import mirrored, relative_place_deviation_m
from fmfts_simulation.cylinder import cylinder_field


def _places(pad: Pad) -> slice:
    return slice(FIRST_PLACE, FIRST_PLACE + pad.sensors.position_m.size)


@pytest.mark.parametrize("free_octupole", [False, True])
def test_derivatives_are_those_of_the_field(pad: Pad, free_octupole: bool) -> None:
    drawing = Drawing(pad, SKETCH, free_octupole)
    vector = np.random.default_rng(1).normal(0.0, 0.7, len(drawing.deviation))
    state = drawing.geometry(vector).rest.stepped(np.array([2e-4, -1e-4, -4e-4, 0.05, 0.02]))

    def field(moved: np.ndarray, step: np.ndarray) -> np.ndarray:
        geometry = drawing.geometry(moved)
        moment = replace(state, log_moment=geometry.rest.log_moment).stepped(step)
        return drawing.derivatives(geometry, moment)[0]

    _, by_pose, by_vector = drawing.derivatives(drawing.geometry(vector), state)
    none = np.zeros(5)
    for column in range(FIRST_PLACE - 2, len(vector)):
        step = 1e-4 * np.eye(len(vector))[column]
        slope = (field(vector + step, none) - field(vector - step, none)) / 2e-4
        np.testing.assert_allclose(by_vector[:, column], slope, rtol=1e-5, atol=1e-12)
    for column, size in enumerate([1e-7, 1e-7, 1e-7, 1e-5, 1e-5]):
        step = size * np.eye(5)[column]
        slope = (field(vector, step) - field(vector, -step)) / 2.0 / size
        np.testing.assert_allclose(by_pose[:, column], slope, rtol=1e-5, atol=1e-9 * np.abs(by_pose[:, column]).max())


@pytest.fixture(scope="module")
def learned_pad() -> tuple[World, Baseline, Mounting, dict[str, object]]:
    world = rough_world(_standard(), 0)
    return world, *make_learned(world.pad, presses(world), bare_and_rest(world))


def _standard() -> Pad:
    from fmfts.config import PadConfig, SimulatedSource

    return PadConfig(name="standard", source=SimulatedSource()).pad()


Made = tuple[World, Baseline, Mounting, dict[str, object]]


@pytest.mark.long
def test_errors_of_learned_places_agree_with_deviations(learned_pad: Made) -> None:
    world, _, mounting, facts = learned_pad
    assert mounting.leftover is not None
    scale = mounting.leftover.unknowns.deviation
    covariance = (mounting.leftover.covariance * scale * scale[:, None])[9:21, 9:21]
    error = (mounting.sensor_position_m - world.places).ravel()
    # χ²₁₂ exceeds 33 once in a thousand; the sketch itself would be at 1000.
    assert error @ np.linalg.solve(covariance, error) < 33.0
    assert (
        np.sqrt(np.mean(error**2))
        < 0.5e-3
        < 1.0e-3
        < np.sqrt(np.mean((world.pad.sensors.position_m - world.places) ** 2))
    )
    assert facts["starts_that_agree"] == "6 of 6"
    assert "press next at about" in str(facts["press_next"])


def test_learned_places_are_good_to_a_tenth_of_a_millimetre(learned_pad: Made) -> None:
    """Places but for the growth, turns and shifts that all of them have in common."""
    world, _, mounting, _ = learned_pad
    r = world.places - world.rest.position_m
    common = np.stack([r, *(np.cross(axis, r) for axis in np.eye(3)), *(np.tile(axis, (4, 1)) for axis in np.eye(3))])
    basis = np.linalg.qr(common.reshape(7, -1).T)[0]
    error = (mounting.sensor_position_m - world.places).ravel()
    assert np.linalg.norm(error - basis @ basis.T @ error) < 3.0e-4


def test_file_keeps_what_was_learned(learned_pad: Made, tmp_path) -> None:  # type: ignore[no-untyped-def]
    world, baseline, mounting, _ = learned_pad
    file = tmp_path / "pad.json"
    file.write_bytes(encode(baseline))
    again = load(file, world.pad)
    assert again is not None
    np.testing.assert_array_equal(again.mounting(world.pad).sensor_position_m, mounting.sensor_position_m)
    assert baseline.learned is not None
    for wrong in (
        {"place_m": ((2.0, 0.0, 0.0),) * 4},
        {"rotation_rad": ((4.0, 0.0, 0.0),) * 4},
        {"rotation_rad": baseline.learned.rotation_rad[:3]},
        {"pose": ((0.0, 0.0, 0.0, 1.1, 0.0, 0.0),)},
    ):
        geometry = msgspec.to_builtins(baseline.learned) | wrong
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert(geometry, type(baseline.learned), strict=False)


def test_drawing_allows_the_tilt_of_magnet_and_pad_together(pad: Pad) -> None:
    drawing = Drawing(pad, replace(SKETCH, magnet_tilt_rad=0.003, pad_tilt_rad=0.004))
    np.testing.assert_allclose(drawing.deviation[3:5], 0.005)


def test_pad_turns_back_by_the_tilt_of_its_learned_magnet(learned_pad: Made) -> None:
    """Learned chips may be turned together with their magnet, whose movement is in the same axes: no tilt is added."""
    world, baseline, _, _ = learned_pad
    tilting = msgspec.structs.replace(baseline, tolerance=baseline.tolerance | {"pad_tilt_rad": 0.02}).sealed()
    mounting = tilting.mounting(world.pad)
    assert mounting.leftover is not None
    share = mounting.leftover.pad_share
    assert share > 0.5
    back = pad_turn_of(mounting.rest.axis, world.pad.rest_axis, share)
    np.testing.assert_allclose(mounting.pad_turn, back, atol=1e-6)
    assert np.abs(back - np.eye(3)).max() > 1e-3, "the test needs a tilt"


@pytest.mark.long
def test_more_presses_are_added_and_refine_sends_to_them(learned_pad: Made) -> None:
    world, baseline, mounting, _ = learned_pad
    more, better, _ = make_learned(world.pad, presses(world, 40), baseline)
    assert baseline.refine is not None
    assert more.refine is not None
    assert len(more.refine.field_t) > len(baseline.refine.field_t)
    was, now = (np.sqrt(np.diagonal(one.leftover.covariance)[9:21]).sum() for one in (mounting, better) if one.leftover)
    assert now < was
    with pytest.raises(BaselineError, match="add to them with --learn, not with --refine"):
        make_refined(world.pad, presses(world), baseline)


def test_learning_names_missing_presses_and_baselines(pad: Pad) -> None:
    world = rough_world(pad, 3)
    before = bare_and_rest(world)
    with pytest.raises(BaselineError, match=r"only 12 different presses were found, of at least 30"):
        make_learned(pad, presses(world, 12), before)
    with pytest.raises(BaselineError, match=r"rest is not recorded: .*then --learn"):
        make_learned(pad, presses(world), None)
    with pytest.raises(BaselineError, match="bare is not recorded, and with a rough drawing"):
        make_learned(pad, presses(world), msgspec.structs.replace(before, bare=None))


@pytest.mark.long
def test_steel_is_not_learned_as_geometry(pad: Pad) -> None:
    world = rough_world(pad, 3)
    pressed = presses(world, 40)
    field = pressed.field_t + world.random.normal(0.0, 3e-6, pressed.field_t.shape)
    with pytest.raises(BaselineError, match=r"do not fit one magnet above these sensors: .* keep steel away"):
        make_learned(pad, replace(pressed, field_t=field), bare_and_rest(world))


@pytest.mark.long
def test_length_scale_without_prior_stays_unknown(pad: Pad) -> None:
    world = rough_world(pad, 1)
    loose = replace(SKETCH, remanence=0.5, magnet_position_m=3e-3, sensor_position_m=3e-3)
    found = learn(Drawing(pad, loose), fields(world, presses(world)), starts=2)
    assert any("the length scale is known to" in one for one in found.open)


def test_presses_in_the_middle_leave_places_open(pad: Pad) -> None:
    """They push the magnet down, and hardly tilt it."""
    world = rough_world(pad, 1)
    found = learn(Drawing(pad, SKETCH), fields(world, presses(world, 40, reach_m=0.2e-3)), starts=2)
    assert any("hardly tilt the magnet" in one for one in found.open)


def test_mirror_image_is_reported_where_the_drawing_allows_it(pad: Pad) -> None:
    world = rough_world(pad, 2)
    anywhere = replace(SKETCH, sensor_rotation_rad=np.radians(150.0), magnet_position_m=20e-3)
    drawing, pressed = Drawing(pad, anywhere), fields(world, presses(world, 40))
    found = Bundle(drawing, pressed).fit(np.zeros(len(drawing.deviation)), 60)
    image = mirrored(drawing, found.vector)
    assert image is not None
    here, there = drawing.geometry(found.vector), drawing.geometry(image)
    assert np.sign(here.rest.position_m[2]) == -np.sign(there.rest.position_m[2])
    np.testing.assert_allclose(
        drawing.derivatives(there, there.rest)[0], drawing.derivatives(here, here.rest)[0], atol=1e-9
    )
    assert any("mirror image fits as well" in one for one in learn(drawing, pressed, starts=2).open)
    assert mirrored(Drawing(pad, SKETCH), found.vector) is None


def test_only_missing_values_are_left_out(pad: Pad) -> None:
    """Chips of two axes on three of four places, and one clipped value in every third press."""
    world = rough_world(pad, 4)
    whole = fields(world, presses(world, 60))
    rest, press = whole.rest_t.copy(), whole.press_t.copy()
    rest[:3, 1] = press[:, :3, 1] = np.nan
    press[::3, 3, 0] = np.nan
    drawing = Drawing(pad, SKETCH)
    found = learn(drawing, replace(whole, rest_t=rest, press_t=press), starts=2)
    error = (drawing.geometry(found.fit.vector).sensors.position_m - world.places).ravel()
    covariance = found.covariance[_places(pad), _places(pad)]
    assert error @ np.linalg.solve(covariance, error) < 33.0
    zero = np.where(np.isnan(press), 0.0, press)
    with pytest.raises(LearnError):
        learn(drawing, replace(whole, press_t=zero), starts=2)


def test_press_without_movement_is_never_suggested(pad: Pad) -> None:
    world = rough_world(pad, 5)
    drawing = Drawing(pad, SKETCH)
    pressed = fields(world, presses(world, 40))
    found = learn(drawing, pressed, starts=1)
    firm = np.array([1e-4, 1e-4, -8e-4, 0.05, 0.05])
    told = next_press(found, pressed, np.array([np.zeros(5), firm]))
    assert told.number == 1
    assert told.then_m < told.now_m
    # The result of such presses matches its promise.
    state = drawing.geometry(found.fit.vector).rest.stepped(firm)
    one = drawing.derivatives(drawing.geometry(found.fit.vector), state)[0].reshape(1, 4, 3)
    more = replace(pressed, press_t=np.concatenate([pressed.press_t, np.repeat(one, TIMES, axis=0)]))
    after = Bundle(drawing, more).fit(found.fit.vector, 60)
    np.testing.assert_allclose(relative_place_deviation_m(drawing, after).max(), told.then_m, rtol=0.05)


@pytest.mark.long
def test_octupole_is_learned_where_left_out_presses_fit_better(pad: Pad) -> None:
    """Of a magnet that is longer and thinner than drawn, near its sensors; fields of the exact cylinder."""
    drawn, longer = Magnet(1.8e-3, 0.9e-3, 1.3), Magnet(1.4e-3, 1.488e-3, 1.3)
    assert octupole_factor(_near_magnet(pad, drawn, drawn)) is None
    factor = octupole_factor(_near_magnet(pad, drawn, longer))
    assert factor is not None
    # The drawing's own tolerance pulls it back.
    assert drawn.octupole_m2 + 0.25e-6 < factor * drawn.octupole_m2 < longer.octupole_m2


def _near_magnet(pad: Pad, drawn: Magnet, true: Magnet) -> Learned:
    random = np.random.default_rng(6)
    places = np.array([[1.2, 1.2, 0.0], [1.2, -1.2, 0.0], [-1.2, 1.2, 0.0], [-1.2, -1.2, 0.0]]) * 1e-3
    near = replace(pad, sensors=SensorArray.aligned(places), magnet=drawn, rest_position_m=np.array([0, 0, 3e-3]))
    positions = near.rest_position_m + random.uniform(-5e-4, 5e-4, (60, 3))
    axes = np.column_stack([random.uniform(-0.2, 0.2, (60, 2)), np.ones(60)])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)

    def seen(position_m: np.ndarray, axis: np.ndarray) -> np.ndarray:
        return cylinder_field(places, np.tile(position_m, (4, 1)), np.tile(axis, (4, 1)), true)

    deviation = np.full((4, 3), 5e-6)
    press = np.array([seen(*each) for each in zip(positions, axes, strict=True)])
    press += random.normal(0.0, 5e-6, press.shape)
    tolerance = replace(SKETCH, sensor_position_m=2e-4, sensor_rotation_rad=0.03, gain=0.01, magnet_position_m=2e-4)
    pressed = Fields(seen(near.rest_position_m, np.array([0.0, 0.0, 1.0])), press, deviation, deviation)
    return with_octupole(learn(Drawing(near, tolerance), pressed, starts=1), pressed)


def test_chosen_presses_are_far_apart(pad: Pad) -> None:
    world = rough_world(pad, 0)
    one = presses(world, 5).field_t
    picked = spread_out(np.concatenate([one, one, one]), world.field())
    assert len(picked) == 5
