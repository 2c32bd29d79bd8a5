"""The compiled search for fingers and poses against NumPy's linear algebra: the results of each step at its end.

The field, its slope and its covariance C are the product's, which test_several.py judges. Everything else is least
squares on the present values, with the residual r and the slope J: docs/several.md and the docstrings of several/.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from several_world import fingers_of, masked, measured_of, models_of

from fmfts.pose.magnets import Magnets
from fmfts.several.field_model import FieldModel, Predicted
from fmfts.several.fit import FLOOR, STARTS, Fit, Fitter, Measured
from fmfts.several.free_poses import FARTHEST, free_poses
from fmfts.several.poses import UNFELT, poses_of
from fmfts.several.valley import LEAST_FORCE_N, valley_variance
from oracle.field import Array
from oracle.poses import at
from oracle.test_several import pads

# Magnets, sensors, causes, knots, terms: the usual pad, the least, the most, and sizes that fill no register.
PADS = [(4, 8, 48, 15, 1), (1, 2, 1, 4, 3), (9, 16, 96, 12, 8), (3, 5, 7, 6, 2), (2, 7, 0, 31, 2)]
SIZES = pytest.mark.parametrize("sizes", PADS)
# For numbers after many roundings and a matrix of some condition.
CLOSE = 1e-6
NOBODY, NO_CHANGE = np.zeros((0, 3)), np.zeros(3)


class White(NamedTuple):
    """C (U, U) of the present values; r (U,) and J (U, unknowns) in its deviations: L⁻¹r, L⁻¹J."""

    L: Array
    residual: Array
    slope: Array

    def of(self, values: Array) -> Array:
        return np.asarray(np.linalg.solve(self.L, values))


def white(model: FieldModel, fingers: Array, measured: Measured, around_t: Array) -> White:
    predicted = model.predict(fingers)
    return whitened(model, fingers, predicted, predicted.slope, measured, around_t)


def whitened(
    model: FieldModel, fingers: Array, predicted: Predicted, slope: Array, measured: Measured, around_t: Array
) -> White:
    used = measured.used
    C = model.covariance(fingers, predicted, measured.variance_t2, around_t)
    if measured.foreign_t2 is not None:
        C = C + measured.foreign_t2
    L = np.linalg.cholesky(C[np.ix_(used, used)])
    residual = np.linalg.solve(L, (measured.field_t - predicted.field_t)[used])
    return White(L, residual, np.linalg.solve(L, slope[used]))


def near(told: Array | float, wanted: Array | float, share: float = CLOSE) -> None:
    wanted = np.asarray(wanted)
    assert np.abs(told - wanted).max(initial=0.0) <= share * np.abs(wanted).max(initial=0.0) + 1e-300


def near_covariance(told: Array, wanted: Array) -> None:
    deviation = np.sqrt(np.diag(wanted))
    assert np.abs((told - wanted) / np.outer(deviation, deviation)).max(initial=0.0) < CLOSE


def worlds(sizes: tuple[float, ...], seed: int, count: int) -> list[tuple[Fitter, Measured, Array]]:
    """Fields of one to three fingers, without some sensors or single values, and beside other pads."""
    fitter, random = Fitter(models_of(1, *sizes)), np.random.default_rng(seed)  # type: ignore[arg-type]
    true = [fingers_of(random, trial % 3 + 1) for trial in range(count)]
    return [
        (fitter, masked(random, measured_of(random, fitter.model, each), trial), each)
        for trial, each in enumerate(true)
    ]


@SIZES
def test_root_and_chi2_are_those_of_the_covariance(sizes: tuple[int, ...]) -> None:
    random = np.random.default_rng(7)
    for fitter, measured, true in worlds(sizes, 7, 24):
        fingers, around = fingers_of(random, len(true) - 1), random.normal(0.0, 2e-5, 3)
        known = white(fitter.model, fingers, measured, around)
        root = fitter.whitener(fingers, measured, around)
        assert not np.triu(root, 1).any()
        near(root @ root.T, known.L @ known.L.T)
        residual = np.linalg.solve(known.L, (measured.field_t - fitter.model.predict(true).field_t)[measured.used])
        assert fitter.chi2_with(root, true, measured) == pytest.approx(residual @ residual, rel=CLOSE)


@SIZES
@pytest.mark.parametrize("beyond", [False, True], ids=["on the table", "beyond it"])
def test_fit_reports_covariance_chi2_ambient_and_shear_at_its_end(sizes: tuple[int, ...], beyond: bool) -> None:
    random, model = np.random.default_rng(6), models_of(1, *sizes)
    for number, (fitter, measured, true) in enumerate(worlds(sizes, 6, 24)):
        around = random.normal(0.0, 2e-5, 3)
        fit = fitter.fit(fingers_of(random, len(true), beyond), measured, around, few_iterations=bool(number // 3 % 2))
        told, used = white(model, fit.fingers, measured, around), measured.used
        spread = np.linalg.inv(told.slope.T @ told.slope + np.diag(np.tile(FLOOR, len(true))))
        near_covariance(fit.covariance, spread)
        assert fit.chi2 == pytest.approx(told.residual @ told.residual, rel=CLOSE)
        near(fit.misfit_t[used], (measured.field_t - model.predict(fit.fingers).field_t)[used])
        toward = told.of(model.by_ambient[used])
        near(fit.ambient_t, model.scene.ambient_t**2 * toward.T @ told.residual)
        # Of a cause of deviation one, whose effect is g: g'C⁻¹r, with the variance 1 − g'C⁻¹g + h'Σh, h = J'C⁻¹g.
        predicted = model.predict(fit.fingers)
        by_shear = np.concatenate([one.by_shear for one in predicted.pressed], axis=1)
        prior_n = np.repeat(model.scene.friction * fit.fingers[:, 2], 2)
        g = told.of((predicted.by_pose @ (model._si[:, None] * by_shear))[used]) * prior_n
        h = told.slope.T @ g
        variance = 1.0 - (g * g).sum(axis=0) + (h * (spread @ h)).sum(axis=0)
        near(fit.shear_n.ravel(), prior_n * (g.T @ told.residual))
        near(fit.shear_deviation_n.ravel() ** 2, prior_n**2 * np.maximum(variance, 0.0))


@pytest.mark.parametrize("sizes", PADS[:4])  # the table of the last one is jagged: it has other minima nearby
def test_fit_from_a_near_start_ends_at_a_minimum(sizes: tuple[int, ...]) -> None:
    """The search ends where a step is below 0.03 deviations; at the table's edge a finger may go no further."""
    random, settled, tried = np.random.default_rng(5), 0, 0
    for fitter, measured, true in worlds(sizes, 5, 24):
        if measured.used.sum() < 3 * len(true) or (np.diff(true[:, :2], axis=0).size and near_each_other(true)):
            continue
        fit = fitter.fit(true + random.normal(0.0, [0.2, 0.2, 0.05], true.shape), measured, NO_CHANGE)
        if (fit.fingers <= fitter._lowest).any() or (fit.fingers >= fitter._highest).any():
            continue
        told = white(fitter.model, fit.fingers, measured, NO_CHANGE)
        left, deviation = fit.covariance @ told.slope.T @ told.residual, np.sqrt(np.diag(fit.covariance))
        tried += 1
        settled += (np.abs(left) < 0.1 * deviation).all()
    assert settled >= 0.8 * tried > 3


def near_each_other(fingers: Array) -> bool:
    apart = fingers[:, None, :2] - fingers[None, :, :2]
    return bool((np.linalg.norm(apart, axis=2) + 1e3 * np.eye(len(fingers)) < 8.0).any())


@pytest.mark.parametrize("sizes", [*PADS, (9, 16, 64, 12, 8, 30.0)])
def test_scan_finds_the_best_places_of_the_grid(sizes: tuple[float, ...]) -> None:
    """The best is at least as good as any, by least squares of the forces alone; pairs are the best distinct ones."""
    random, found = np.random.default_rng(8), 0
    for fitter, measured, true in worlds(sizes, 8, 12 if len(sizes) == 5 else 3):
        root, places = fitter.whitener(fingers_of(random, len(true) - 1), measured, NO_CHANGE), fitter.places
        t = np.linalg.solve(root, fitter.grid.templates[:, measured.used].T).T
        a, s = t @ np.linalg.solve(root, measured.field_t[measured.used]), (t * t).sum(axis=1)
        single, gain = fitter.best_single(root, measured)
        gains = np.where(a > 0.0, a * a / np.where(s > 0.0, s, 1.0), 0.0)
        at_place = number_of(places, single[0])
        assert gain == pytest.approx(gains.max(), rel=CLOSE)
        assert gains[at_place] == pytest.approx(gains.max(), rel=CLOSE)
        assert single[0, 2] == pytest.approx(a[at_place] / s[at_place] if s[at_place] > 0.0 else 0.0, rel=1e-5)
        one, other = np.triu_indices(len(places), 1)
        apart = ((places[one, :2] - places[other, :2]) ** 2).sum(axis=1) >= 64.0
        one, other = one[apart], other[apart]
        c = (t @ t.T)[one, other]
        d = s[one] * s[other] - c * c
        first, second = a[one] * s[other] - a[other] * c, a[other] * s[one] - a[one] * c
        good = (first > 0.0) & (second > 0.0) & (d > 1e-9 * s[one] * s[other])
        gain_of = np.where(good, (first * a[one] + second * a[other]) / np.where(good, d, 1.0), 0.0)
        for most in (1, STARTS, 8):
            pairs = fitter.best_pairs(root, measured, most)
            found += len(pairs)
            left = gain_of.copy()
            for pair in pairs:
                numbers = {number_of(places, pair[0]), number_of(places, pair[1])}
                (which,) = np.flatnonzero((one == min(numbers)) & (other == max(numbers)))
                # It is the best of the pairs that have no better one nearby.
                assert gain_of[which] == pytest.approx(left.max(), rel=1e-5)
                forces = np.linalg.lstsq(t[[one[which], other[which]]].T, white_field(root, measured), rcond=None)[0]
                by_number = dict(zip((one[which], other[which]), forces, strict=True))
                near(pair[:, 2], np.array([by_number[number_of(places, each)] for each in pair]), 1e-4)
                near_it = np.abs(places[np.stack([one, other], axis=1), :2] - pair[:, :2]).max(axis=(1, 2)) <= 3.0
                left[near_it] = 0.0
            assert len(pairs) == most or left.max() <= 1e-9
    assert found > 5, "there was nothing to compare"


def white_field(root: Array, measured: Measured) -> Array:
    return np.asarray(np.linalg.solve(root, measured.field_t[measured.used]))


def number_of(places: Array, finger: Array) -> int:
    (number,) = np.flatnonzero((places[:, :2] == finger[:2]).all(axis=1))
    return int(number)


@SIZES
def test_one_more_finger_lowers_chi2_as_least_squares_says(sizes: tuple[int, ...]) -> None:
    """Beside other fingers, which may move a little for it."""
    gained = 0
    for fitter, measured, true in worlds(sizes, 12, 12):
        root = fitter.whitener(true, measured, NO_CHANGE)
        known = white(fitter.model, true, measured, NO_CHANGE)
        another = fitter.another(root, true, measured)
        normal = known.slope.T @ known.slope + 1e-9 * np.eye(3 * len(true))
        t = known.of(fitter.grid.templates[:, measured.used].T)
        moved = np.linalg.solve(normal, known.slope.T @ t)
        left, r = t - known.slope @ moved, known.residual
        rest = r - known.slope @ np.linalg.solve(normal, known.slope.T @ r)
        a, s = left.T @ rest, (left * left).sum(axis=0)
        s = np.where(s > 0.0, s, 1.0)
        apart = (np.linalg.norm(fitter.places[:, None, :2] - true[None, :, :2], axis=2) >= 8.0).all(axis=1)
        certain = s > 1e-6 * (t * t).sum(axis=0)  # rounding is all that remains of a place that the others explain
        near(another.gain[certain], np.where((a > 0.0) & apart, a * a / s, 0.0)[certain], 1e-5)
        near(another.force[certain], (a / s)[certain], 1e-5)
        near(another.by_force, moved, 1e-5)
        gained += int((another.gain > 0.0).sum())
        if len(true) == 1:
            pairs = fitter.best_seconds(root, true, measured)
            gains = [another.gain[number_of(fitter.places, pair[1])] for pair in pairs]
            assert gains == sorted(gains, reverse=True)
            assert not gains or gains[0] == another.gain.max()
            assert all(np.array_equal(pair[0], true[0]) for pair in pairs)
    assert gained > 20, "there was nothing to compare"


@SIZES
def test_valley_is_what_two_steps_across_each_uncertain_place_leave(sizes: tuple[int, ...]) -> None:
    """Each is a step of least squares with one sum held: unknowns, and the multiplier of the constraint."""
    random, reached, certain, farther = np.random.default_rng(13), 0, 0, 0
    for trial, (fitter, measured, true) in enumerate(worlds(sizes, 13, 24)):
        count, size = len(true), 0.01 if trial % 8 == 7 else 1.0
        root = random.normal(0.0, size, (3 * count, 3 * count)) * np.tile([0.4, 0.4, 0.05], count)
        fit = replace(
            fitter.fit(fingers_of(random, count), measured, NO_CHANGE), fingers=true, covariance=root.T @ root
        )
        told = valley_variance(fitter, fit, measured, np.full(3, 1e-5))
        held = white(fitter.model, true, measured, np.full(3, 1e-5))
        least, ways = np.zeros((1 + count, 3)), 0
        for first in range(0, 3 * count, 3):
            power, axes = np.linalg.eigh(fit.covariance[first : first + 2, first : first + 2])
            if power[-1] <= 0.3**2:
                continue
            direction = np.zeros(3 * count)
            direction[first : first + 2] = axes[:, -1]
            ways += 1
            if count == 1:
                least = np.maximum(least, moved_outward(fitter, fit, measured, held, direction, power[-1]))
                continue
            for side in (1.0, -1.0):
                for deviations in (3.0, 6.0):
                    away = fit.covariance @ direction * (deviations / np.sqrt(power[-1]))
                    fingers = clipped(fitter, true.ravel() + side * away)
                    for _ in range(2):
                        step = step_across(fitter, held, fingers, direction, measured)
                        fingers = clipped(fitter, fingers.ravel() + step)
                    residual = held.of((measured.field_t - fitter.model.predict(fingers).field_t)[measured.used])
                    off = np.concatenate([[whole(fingers) - whole(true)], fingers - true])
                    rise = residual @ residual - fit.chi2
                    least = np.maximum(least, off * off / max(rise, 1.0))
                    if rise >= 0.7 * 3.0**2:  # not much flatter than a parabola
                        break
                    farther += deviations == 3.0
        assert (told is None) == (ways == 0)
        certain += told is None
        if told is not None:
            near(told, least, 1e-3)
            reached += 1
    assert reached > 10, "there was nothing to compare"
    assert certain, "all were uncertain"
    assert farther, "no valley went on"


def moved_outward(
    fitter: Fitter, fit: Fit, measured: Measured, held: White, direction: Array, variance: float
) -> Array:
    """(2, 3) variances of one finger, moved to where it presses harder, and judged by its likelihood there."""
    away = fit.covariance @ direction * (3.0 / np.sqrt(variance))
    finger = clipped(fitter, fit.fingers.ravel() + (-away if away[2] < 0.0 else away))
    finger = clipped(fitter, finger.ravel() + step_across(fitter, held, finger, direction, measured))
    there = white(fitter.model, finger, measured, np.full(3, 1e-5))
    finger = clipped(fitter, finger.ravel() + step_across(fitter, there, finger, direction, measured))
    residual = there.of((measured.field_t - fitter.model.predict(finger).field_t)[measured.used])
    wider = 2.0 * float(np.log(np.diag(there.L) / np.diag(held.L)).sum())
    off = finger - fit.fingers
    return np.asarray(np.tile(off * off, (2, 1)) / max(residual @ residual - fit.chi2 + wider, 1.0))


def whole(fingers: Array) -> Array:
    force = fingers[:, 2]
    return np.append(fingers[:, :2].T @ force, force.sum()) / np.array([force.sum(), force.sum(), 1.0])


def step_across(fitter: Fitter, held: White, fingers: Array, direction: Array, measured: Measured) -> Array:
    predicted = fitter.model.predict(fingers)
    J = held.of(predicted.slope[measured.used])
    r = held.of((measured.field_t - predicted.field_t)[measured.used])
    normal = J.T @ J + np.diag(np.tile(FLOOR, len(fingers)))
    size = np.sqrt(np.diag(normal))
    bordered = np.block([[normal / size / size[:, None], (direction / size)[:, None]], [direction / size, 0.0]])
    return np.asarray(np.linalg.solve(bordered, np.append(J.T @ r / size, 0.0))[:-1] / size)


def clipped(fitter: Fitter, fingers: Array) -> Array:
    response, each = fitter.model.response, fingers.reshape(-1, 3)
    place = np.clip(each[:, :2], response.first_mm, response.last_mm)
    return np.column_stack([place, np.maximum(each[:, 2], LEAST_FORCE_N)])


@pytest.mark.parametrize("sizes", [(4, 8, 2), (2, 9, 3)])
def test_poses_are_the_table_corrected_by_the_residual(sizes: tuple[int, int, int]) -> None:
    """A x + W r with W = B B' P' C⁻¹, and B B' − W P B B' + (A − W J) Σ (A − W J)': several/poses.py."""
    random, (model, oracle) = np.random.default_rng(15), pads(*sizes)
    fitter = Fitter(model)
    for trial in range(6):
        fingers = fingers_of(random, trial % 3 + 1)
        measured, around = masked(random, measured_of(random, model, fingers), trial), random.normal(0.0, 2e-5, 3)
        used = measured.used
        fit: Fit = replace(fitter.fit(fingers, measured, around), fingers=fingers)
        told = poses_of(fitter, fit, measured, around)
        BB = oracle.considered(fingers)
        known, predicted = white(model, fingers, measured, around), model.predict(fingers)
        C = known.L @ known.L.T
        A = np.concatenate([one.slope for one in predicted.pressed], axis=1) * model._si[:, None]
        P, J = predicted.by_pose[used], predicted.slope[used]
        W = BB @ P.T @ np.linalg.inv(C)
        near(told.change, oracle.change(fingers) + W @ fit.misfit_t[used], 1e-4)
        near_magnets(model, told.magnets, told.change)
        left = A - W @ J
        wanted = np.diag(np.tile(UNFELT, len(BB) // 5) ** 2) + BB - W @ P @ BB + left @ fit.covariance @ left.T
        deviation = np.sqrt(np.diag(wanted))
        assert np.abs((told.covariance - wanted) / np.outer(deviation, deviation)).max() < 1e-4
        assert told.variance.ravel() == pytest.approx(np.diag(wanted), rel=1e-4)


@SIZES
def test_free_poses_report_covariance_and_chi2_at_their_end(sizes: tuple[int, ...]) -> None:
    random = np.random.default_rng(31)
    farthest, model = np.tile(FARTHEST, int(sizes[0])), models_of(1, *sizes)
    for trial in range(12):
        change = random.normal(0.0, np.tile([2e-4, 2e-4, 3e-4, 0.05, 0.05], int(sizes[0])))
        rest = measured_of(random, model, NOBODY)
        measured = masked(random, replace(rest, field_t=rest.field_t + at(model, change).field_t), trial)
        start = change * random.normal(0.0, 1.5, len(change)) if trial % 2 else np.zeros(len(change))
        around = random.normal(0.0, 2e-5, 3)
        found = free_poses(model, start, measured, around)
        predicted = at(model, found.change)
        near(found.predicted.by_pose, predicted.by_pose)
        near(found.predicted.change, predicted.change)
        told = whitened(model, NOBODY, predicted, predicted.by_pose, measured, around)
        near_covariance(found.covariance, np.linalg.inv(told.slope.T @ told.slope + np.diag(farthest**-2.0)))
        assert found.chi2 == pytest.approx(told.residual @ told.residual, rel=CLOSE)
        near(found.misfit_t[measured.used], (measured.field_t - predicted.field_t)[measured.used])
        near(found.ambient_t, model.scene.ambient_t**2 * told.of(model.by_ambient[measured.used]).T @ told.residual)
        assert (np.abs(found.change) <= farthest).all()
        near_magnets(model, found.magnets, found.change)


def near_magnets(model: FieldModel, told: Magnets, change: Array) -> None:
    """change: of position, and the x and y of the axis in each magnet's own frame."""
    rest, moved = model.mounting.magnets, change.reshape(-1, 5)
    axis = np.column_stack([moved[:, 3:], np.sqrt(1.0 - (moved[:, 3:] ** 2).sum(axis=1))])
    np.testing.assert_allclose(told.position_m, rest.position_m + moved[:, :3], rtol=1e-12)
    np.testing.assert_allclose(told.axis, np.einsum("mij,mj->mi", model.mounting.frames, axis), atol=1e-12)
    assert np.array_equal(told.strength_t_m3, rest.strength_t_m3)
    assert np.array_equal(told.octupole_m2, rest.octupole_m2)
