"""The poses of all magnets by the field alone: where the magnets are, and when they are not told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from several_world import measured_of
from test_several_compiled import NONE, USUAL, fitter_of

from fmfts.arithmetic.matrix import SingularError
from fmfts.pose.observable import are_observable, needed_values
from fmfts.several.field_model import FieldModel
from fmfts.several.free_poses import FARTHEST, free_poses, is_explained
from fmfts.several.measured import Measured
from fmfts.several.odd_pose_sensor import Values, odd_pose_sensor
from fmfts_lab.bench.several_layouts import LAYOUTS
from fmfts_lab.bench.several_world import BUILT, BY_HAND, World, any_press, world
from oracle.poses import at

MOVED = np.array([2e-4, 2e-4, 3e-4, 0.05, 0.05])
OBSERVABLE = ["2 over 8", "3 over 8", "4 over 12", pytest.param("4 over 16", marks=pytest.mark.long)]


def moved(random: np.random.Generator, model: FieldModel) -> tuple[np.ndarray, Measured]:
    """A change of all poses, and the field after it, with noise and another ambient field."""
    change = random.normal(0.0, np.tile(MOVED, len(model.mounting.magnets)))
    rest = measured_of(random, model, np.zeros((0, 3)))
    return change, replace(rest, field_t=rest.field_t + at(model, change).field_t)


def test_non_finite_value_is_refused_by_name() -> None:
    model = fitter_of(*USUAL).model
    change, good = moved(np.random.default_rng(32), model)
    broken = replace(good, variance_t2=np.where(np.arange(24) == 7, np.inf, good.variance_t2))
    nowhere, negative = replace(good, field_t=good.field_t * np.nan), replace(good, variance_t2=good.variance_t2 - 1.0)
    for name, refused in {
        "start: number 0 is nan": lambda: free_poses(model, change * np.nan, good, NONE),
        "ambient_t: number 0 is nan": lambda: free_poses(model, change, good, NONE + np.nan),
        "variance_t2: number 7 is inf": lambda: free_poses(model, change, broken, NONE),
        "field_t: number 0 is nan": lambda: free_poses(model, change, nowhere, NONE),
        "not positive definite": lambda: free_poses(model, change, negative, NONE),
    }.items():
        with pytest.raises(ValueError, match=name):
            refused()
    with pytest.raises(SingularError):
        free_poses(model, change, negative, NONE)


def pressed_worlds(name: str, pads: int = 6, of_each: int = 5) -> Iterator[tuple[World, np.ndarray, Measured]]:
    """Pads as built, pressed by up to three fingers: with the true change of the poses."""
    for number in range(pads):
        one = world(40 + number, BUILT, layout=LAYOUTS[name])
        for fingers in range(of_each):
            change = one.pressed([any_press(one.random) for _ in range(fingers % 4)])
            yield one, change, one.measured(change)


@pytest.mark.parametrize("name", OBSERVABLE)
def test_magnets_are_found_from_rest_within_their_deviations(name: str) -> None:
    squares = []
    for one, change, measured in pressed_worlds(name):
        if np.abs(change.reshape(-1, 5) / FARTHEST).max() > 0.9:
            continue  # three hard presses on one magnet
        found = free_poses(one.fitter.model, np.zeros(len(change)), measured, np.zeros(3))
        assert is_explained(found, measured.used.reshape(-1, 3))
        off = (found.change - change) / np.sqrt(found.variance)
        assert np.abs(off).max() < 5.0
        squares.append(float((off * off).mean()))
    # One in truth; that errors of a change are taken at half a press leaves up to a third of the variance.
    assert 0.6 < np.mean(squares) < 1.5
    assert len(squares) > 20


@pytest.mark.long
def test_deviations_cover_hard_presses_on_handmade_pads() -> None:
    """Errors are known for half a press. Taken as they are, the mean square is 1.5 and more of three fingers."""
    squares = []
    for number in range(16):
        one = world(60 + number, BY_HAND, layout=LAYOUTS["4 over 12"])
        for _ in range(4):
            change = one.pressed([any_press(one.random) for _ in range(3)])
            if np.abs(change.reshape(-1, 5) / FARTHEST).max() > 0.9:
                continue
            found = free_poses(one.fitter.model, np.zeros(len(change)), one.measured(change), np.zeros(3))
            squares.append(float(((found.change - change) ** 2 / found.variance).mean()))
    assert len(squares) > 40
    assert 0.6 < np.mean(squares) < 1.4


@pytest.mark.parametrize("name", OBSERVABLE)
def test_foreign_magnet_is_not_taken_for_moved_magnets(name: str) -> None:
    """0.2 A·m² at 60 mm and nearer: a magnet of 1 cm³."""
    for one, change, measured in pressed_worlds(name, pads=3):
        where = np.array([0.0, 0.0, 12e-3]) + one.random.uniform(0.03, 0.06) * upward(one.random)
        moment = 0.2 * upward(one.random)
        beside = measured.field_t + (dipole(one, where, moment) / one.mounting.gain).ravel()
        found = free_poses(one.fitter.model, change, replace(measured, field_t=beside), np.zeros(3))
        assert not is_explained(found, measured.used.reshape(-1, 3))


def upward(random: np.random.Generator) -> np.ndarray:
    direction = random.standard_normal(3)
    direction[2] = abs(direction[2])
    unit: np.ndarray = direction / np.linalg.norm(direction)
    return unit


def dipole(one: World, where: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """(N, 3) what the chips report of it, in T."""
    away = one.sensors.position_m - where
    far = np.linalg.norm(away, axis=1, keepdims=True)
    field = 1e-7 * (3.0 * away * (away @ moment)[:, None] / far**5 - moment / far**3)
    reported: np.ndarray = one.gain * one.sensors.to_sensor(field)
    return reported


@pytest.mark.parametrize("name", OBSERVABLE)
def test_sensor_that_is_wrong_is_named(name: str) -> None:
    right = tried = 0
    for number, (one, change, measured) in enumerate(pressed_worlds(name)):
        model, sensor = one.fitter.model, number % len(one.sensors)
        off = measured.field_t.copy()
        off[3 * sensor : 3 * sensor + 3] += [3e-5, -4e-5, 2e-5]
        wrong, there = replace(measured, field_t=off), measured.used.reshape(-1, 3)
        found = free_poses(model, change, wrong, np.zeros(3))
        if is_explained(found, there):
            continue  # 3 over 8 has six values to spare, and three of them belong to the sensor
        tried += 1
        values = Values(wrong, there, np.zeros(3))
        odd = odd_pose_sensor(model, found, change, values, needed_values(len(one.magnets)) - 3, 0)
        right += odd is not None and odd.sensor == sensor
    assert tried >= 25
    assert right >= 0.9 * tried


def test_sensor_whose_exclusion_fits_best_is_tried_first() -> None:
    """8 µT on each axis of one: without some other sensor the frame is explained as well, by chance and less well."""
    right = tried = 0
    for number, (one, change, measured) in enumerate(pressed_worlds("3 over 8", pads=12)):
        model, sensor, there = one.fitter.model, number % 8, measured.used.reshape(-1, 3)
        wrong_t = measured.field_t.copy()
        wrong_t[3 * sensor : 3 * sensor + 3] += [8e-6, -8e-6, 8e-6]
        wrong = replace(measured, field_t=wrong_t)
        found = free_poses(model, change, wrong, np.zeros(3))
        if is_explained(found, there):
            continue
        odd = odd_pose_sensor(model, found, change, Values(wrong, there, np.zeros(3)), needed_values(3) - 3, 0)
        tried += odd is not None
        right += odd is not None and odd.sensor == sensor
    assert tried >= 30
    assert right >= 0.7 * tried


def test_search_ending_at_its_limit_is_rejected() -> None:
    one = world(50, BUILT, layout=LAYOUTS["4 over 16"])
    far = np.zeros(20)
    far[2] = -1.5 * FARTHEST[2]
    measured = one.measured(far)
    found = free_poses(one.fitter.model, np.zeros(20), measured, np.zeros(3))
    used = measured.used.reshape(-1, 3)
    assert not is_explained(found, used)
    near = free_poses(one.fitter.model, np.zeros(20), one.measured(0.5 * far), np.zeros(3))
    assert is_explained(near, used)
    at_the_end = np.zeros(20)
    at_the_end[4] = FARTHEST[4]
    assert not is_explained(replace(near, change=at_the_end), used)


def test_poses_need_this_many_values() -> None:
    """Six values beside the five of each magnet and the three of the ambient field: one sensor may fail."""
    assert [needed_values(magnets) for magnets in (1, 2, 3, 4)] == [14, 19, 24, 29]
    assert are_observable(4, 10)
    assert not are_observable(4, 9)
