"""Place, force and shear that contact/sheared.c solves: beside SciPy's least squares, finite differences, and the model
without shear."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fmfts.contact import ContactModel
from fmfts.contact.estimate import ContactEstimate
from fmfts.contact.tolerances import StructureTolerance
from fmfts.contact.touch import TouchDetector
from fmfts.pad import Pad

Array = NDArray[np.float64]
FRICTION, SD_SHARE = 0.6, 0.3  # an even distribution over the cone's disc
SCALE = [1.0, 1.0, 0.1, 0.1, 0.1]
FRAME_SD = np.array([0.015, 0.015, 0.0035, 0.0035, 0.0035])  # deviations of one frame: mm, and components of the axis
UNIT = np.array([1e3, 1e3, 1.0, 1.0, 1.0])
STEP = 0.02
EDGE_MM, LEAST_FORCE_N = 14.0, 0.01  # edge of the table; smallest force of the prior
PRESSES = [
    np.array(press)
    for press in (
        *((0.0, 0.0, 1.5, 0.4, -0.2), (3.0, -2.0, 0.8, -0.2, 0.3), (-6.0, 4.0, 1.2, 0.1, 0.4)),
        *((0.0, 9.0, 1.8, -0.5, -0.3), (11.0, -3.0, 1.0, 0.0, 0.2), (-12.0, -12.0, 1.6, 0.3, 0.0)),
    )
]


def solving(pad: Pad, friction: float = FRICTION, **tolerance: Any) -> ContactModel:
    return ContactModel.load("shear", pad, friction=friction, tolerance=StructureTolerance(**tolerance))


def answer(model: ContactModel, pad: Pad, change: Array, sd: Array = FRAME_SD) -> ContactEstimate:
    """The answer to a change (5,) of pose, in mm and components of an axis of +z."""
    m, n = change[3:].tolist()
    covariance = np.zeros((6, 6))
    covariance[:5, :5] = np.diag((sd * [1e-3, 1e-3, 1e-3, 1.0, 1.0]) ** 2)
    axis = np.array([m, n, np.sqrt(1.0 - m * m - n * n)])
    return model.estimate(pad.rest_position_m + change[:3] * 1e-3, axis, covariance)


def change_of(model: ContactModel, press: Array) -> Array:
    assert model.response is not None
    change: Array = model.response.change(press[None])[0]
    return change


@pytest.mark.parametrize("press", PRESSES)
def test_answer_is_most_likely_press_within_the_cone(pad: Pad, press: Array) -> None:
    model = solving(pad)
    change = change_of(model, press) + FRAME_SD * [0.5, -1.0, 0.3, 1.0, -0.7]

    def residuals(found: Array) -> Array:
        left = (change - change_of(model, found)) / FRAME_SD
        return np.concatenate([left, found[3:] / (SD_SHARE * found[2])])

    found = answer(model, pad, change)
    expected = least_squares(residuals, found.values * UNIT, x_scale=SCALE, xtol=1e-12).x
    assert (np.abs(found.values * UNIT - expected) < 0.1 * found.deviations * UNIT).all()


def test_search_at_the_rim_ends_near_the_least_chi2(pad: Pad) -> None:
    """SciPy's search of the same posterior, within the table, from the answer and from the true press."""
    model, plain, random = solving(pad), ContactModel.load("default", pad), np.random.default_rng(7)
    assert model.response is not None
    farthest_n = 3.0 * model.response.scale_n
    limits = np.array([[-EDGE_MM, -EDGE_MM, 0.0, -farthest_n, -farthest_n], [EDGE_MM, EDGE_MM, *[farthest_n] * 3]])
    over = []
    for _ in range(120):
        place_mm, force_n = random.uniform(-EDGE_MM, EDGE_MM, 2), random.uniform(0.5, 2.0)
        true = np.concatenate(
            [place_mm, [force_n], FRICTION * force_n * np.sqrt(random.uniform()) * _direction(random)]
        )
        if np.hypot(*place_mm) < 8.0:
            continue
        change = change_of(model, true) + FRAME_SD * random.standard_normal(5)

        def residuals(found: Array, change: Array = change) -> Array:
            left = (change - change_of(model, found)) / FRAME_SD
            return np.concatenate([left, found[3:] / (SD_SHARE * max(found[2], LEAST_FORCE_N))])

        standard = answer(plain, pad, change)
        if not standard.force_n > 2.0 * standard.force_sd_n:  # a touch that noise explains is not searched
            continue
        found = answer(model, pad, change).values * UNIT
        inside = [np.clip(press, limits[0] + 1e-6, limits[1] - 1e-6) for press in (found, true)]
        least = min(2.0 * least_squares(residuals, press, x_scale=SCALE, bounds=limits).cost for press in inside)
        over.append(np.sum(residuals(found) ** 2) - least)
    assert len(over) > 40
    assert max(over) < 1.0  # of a deviation squared


@pytest.mark.parametrize("press", PRESSES[:4])
def test_deviations_include_the_widest_finger_to_all_five(pad: Pad, press: Array) -> None:
    """It is two deviations wide: half of how far the answer moves where it is known; and what is wider along x."""
    widths_m = ((6e-3, 6e-3), (6e-3, 12e-3), (12e-3, 12e-3))
    plain, wide, widest = (solving(pad, finger_m=finger_m) for finger_m in widths_m)
    change, step = change_of(plain, press), np.sqrt((12.0**2 - 6.0**2) / 16.0 / 2.0)
    without = answer(plain, pad, change)
    found = without.values * UNIT
    along = [
        (change_of(plain, found + step * axis) + change_of(plain, found - step * axis)) / 2.0 - change_of(plain, found)
        for axis in np.eye(5)[:2]
    ]
    more, less = (answer(plain, pad, change + side * STEP * (along[0] - along[1]) / 2.0) for side in (1.0, -1.0))
    uneven = (more.values - less.values) * UNIT / (2.0 * STEP)
    variance = ((answer(widest, pad, change).values - without.values) * UNIT / 2.0) ** 2 + uneven**2
    added = np.sqrt(answer(wide, pad, change).deviations ** 2 - without.deviations**2) * UNIT
    # The product's deviation is of first order in the finger's movement; the answer to a known finger is not.
    np.testing.assert_allclose(added, np.sqrt(variance), rtol=0.25, atol=0.02)


@pytest.mark.parametrize("width_mm", [3.0, 12.0])
@pytest.mark.parametrize("press", PRESSES[:4])
def test_known_finger_that_shears_reads_as_the_probe_does(pad: Pad, press: Array, width_mm: float) -> None:
    """A wider disc is the probe smeared over a ring: here over one of 60 points."""
    plain, known = solving(pad), solving(pad, finger_m=(width_mm * 1e-3, width_mm * 1e-3))
    moment_mm2 = (width_mm**2 - 6.0**2) / 16.0
    around = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    ring_mm = np.sqrt(2.0 * abs(moment_mm2)) * np.column_stack([np.cos(around), np.sin(around), *np.zeros((3, 60))])
    by_probe = change_of(plain, press)
    more = np.sign(moment_mm2) * (np.mean([change_of(plain, press + each) for each in ring_mm], axis=0) - by_probe)
    expected, found = answer(plain, pad, by_probe), answer(known, pad, by_probe + more)
    # The last of the rounds leaves something; one correction at the press without shear leaves up to a deviation.
    assert (np.abs(found.values - expected.values) < 0.15 * expected.deviations).all()


def test_known_finger_as_wide_as_the_probe_leaves_deviations_of_light_presses(pad: Pad) -> None:
    """Noise could explain the press with which a later round of a known finger begins; it is one all the same."""
    once, in_rounds = (solving(pad, 0.8, finger_m=(width_m, width_m)) for width_m in (6e-3, 6.001e-3))
    random, ratios = np.random.default_rng(5), list[float]()
    for _ in range(400):
        force_n = random.uniform(0.05, 0.3)
        shear_n = 0.8 * force_n * np.sqrt(random.uniform()) * _direction(random)
        press = np.concatenate([random.uniform(-EDGE_MM, EDGE_MM, 2), [force_n], shear_n])
        change = change_of(once, press) + FRAME_SD * random.standard_normal(5)
        one, other = answer(once, pad, change), answer(in_rounds, pad, change)
        if abs(one.force_n - other.force_n) < 0.01 * force_n:
            ratios.append(other.force_sd_n / one.force_sd_n)
    assert len(ratios) > 200
    assert min(ratios) > 0.85
    assert max(ratios) < 1.15


@pytest.mark.parametrize("press", PRESSES)
def test_finger_that_cannot_shear_has_standard_answer(pad: Pad, press: Array) -> None:
    change = change_of(solving(pad), press * [1.0, 1.0, 1.0, 0.0, 0.0])
    standard = answer(ContactModel.load("default", pad), pad, change)
    found = answer(solving(pad, friction=0.0), pad, change)
    np.testing.assert_array_equal(found.values, standard.values)
    assert found.shear_n is None
    nearly = answer(solving(pad, friction=1e-4), pad, change)
    assert (np.abs(nearly.values[:3] - standard.values) < 3.0 * standard.deviations).all()
    assert np.abs(nearly.values[3:]).max() < 1e-3


@pytest.mark.parametrize("press", PRESSES)
def test_more_friction_gives_wider_deviations(pad: Pad, press: Array) -> None:
    change = change_of(solving(pad), press)
    little, much = (answer(solving(pad, friction), pad, change) for friction in (0.1, 0.8))
    assert (little.deviations[3:] < much.deviations[3:]).all()
    assert (np.abs(little.values[3:]) <= np.abs(much.values[3:]).max()).all()


@pytest.mark.parametrize("press", PRESSES)
def test_deviations_are_honest_over_frames_with_noise(pad: Pad, press: Array) -> None:
    """400 frames, each with other shear of the cone: 95 % within two deviations, to 1.1 %."""
    model, plain, random = solving(pad), ContactModel.load("default", pad), np.random.default_rng(5)
    errors = []
    for _ in range(400):
        shear_n = FRICTION * press[2] * np.sqrt(random.uniform()) * _direction(random)
        true = np.concatenate([press[:3], shear_n])
        change = change_of(model, true) + FRAME_SD * random.standard_normal(5)
        found, standard = answer(model, pad, change), answer(plain, pad, change)
        if standard.force_n > 2.0 * standard.force_sd_n:  # a touch that noise explains is no touch
            errors.append((found.values * UNIT - true) / (found.deviations * UNIT))
    inside = np.mean(np.abs(errors) < 2.0, axis=0)
    assert (inside > 0.92).all()
    if np.hypot(*press[:2]) < 10.0:  # not by deviations that are far too large
        assert np.mean(np.abs(errors) < 1.0) < 0.85
    assert np.abs(errors).max() < 5.0


def test_deviation_reaches_every_force_that_is_as_likely(pad: Pad) -> None:
    """Pulled outwards on the rim, a firm press moves the magnet as a light one does. SciPy says how likely each is."""
    model, plain, random = solving(pad, 0.8), ContactModel.load("default", pad), np.random.default_rng(46)
    assert model.response is not None
    top_n, over = 1.5 * model.response.scale_n, list[float]()
    while len(over) < 40:
        place_mm, force_n = random.uniform(-13.9, 13.9, 2), random.uniform(0.5, 2.0)
        radius_mm = np.hypot(*place_mm)
        shear_n = random.uniform(0.6, 0.8) * force_n * place_mm / radius_mm
        change = change_of(model, np.array([*place_mm, force_n, *shear_n])) + FRAME_SD * random.standard_normal(5)
        standard = answer(plain, pad, change)
        if radius_mm < 11.0 or not standard.force_n > 2.0 * standard.force_sd_n:
            continue
        found = answer(model, pad, change)
        press = found.values * UNIT

        def residuals(others: Array, force_n: float, change: Array = change) -> Array:
            left = (change - change_of(model, np.insert(others, 2, force_n))) / FRAME_SD
            return np.concatenate([left, others[2:] / (0.4 * max(force_n, LEAST_FORCE_N))])

        others, least = np.delete(press, 2), np.sum(residuals(np.delete(press, 2), press[2]) ** 2)
        inside, reached_n = (
            [(-EDGE_MM - 1e-9, -EDGE_MM - 1e-9, -6.0, -6.0), (EDGE_MM + 1e-9, EDGE_MM + 1e-9, 6.0, 6.0)],
            0.0,
        )
        for force in np.linspace(press[2], top_n, 10)[1:]:
            fit = least_squares(residuals, others, x_scale=np.delete(SCALE, 2), bounds=inside, args=(force,))
            others, delta = fit.x, 2.0 * fit.cost - least
            if delta < 9.0:
                reached_n = max(reached_n, (force - press[2]) / np.sqrt(max(delta, 1.0)))
        over.append(found.force_sd_n / reached_n if reached_n > 0.0 else 1.0)
    assert min(over) > 0.85
    assert np.median(over) < 1.5  # nor is it far too large


def test_press_whose_force_shear_hides_is_within_its_deviations(pad: Pad) -> None:
    """Beyond 12 mm, where the standard answer could be noise and the movement could not: 3 in 1000 beyond five."""
    model, plain, random = solving(pad), ContactModel.load("default", pad), np.random.default_rng(5)
    onset_chi2 = TouchDetector(220.0).onset_chi2
    model.parameters.put("onset_chi2", onset_chi2)
    errors = []
    for _ in range(3000):
        place_mm, force_n = random.uniform(-13.0, 13.0, 2), random.uniform(0.5, 2.0)
        if np.hypot(*place_mm) < 12.0:
            continue
        shear_n = FRICTION * force_n * np.sqrt(random.uniform()) * _direction(random)
        change = change_of(model, np.array([*place_mm, force_n, *shear_n])) + FRAME_SD * random.standard_normal(5)
        standard = answer(plain, pad, change)
        has_moved = np.sum((change / FRAME_SD) ** 2) > onset_chi2
        if has_moved and not standard.force_n > 2.0 * standard.force_sd_n:
            found = answer(model, pad, change)
            errors.append((found.force_n - force_n) / found.force_sd_n)
    assert len(errors) > 300
    assert np.sum(np.abs(errors) > 5.0) <= 0.003 * len(errors)


def test_movement_searches_no_untouched_frame(pad: Pad) -> None:
    """Noise makes a force of two deviations in 4 of 100 frames. The movement adds one frame an hour: here none."""
    unmoved, moved, random = solving(pad), solving(pad), np.random.default_rng(8)
    moved.parameters.put("onset_chi2", TouchDetector(220.0).onset_chi2)
    for change in FRAME_SD * random.standard_normal((5000, 5)):
        np.testing.assert_array_equal(answer(moved, pad, change).values, answer(unmoved, pad, change).values)


def _direction(random: np.random.Generator) -> Array:
    angle = random.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])
