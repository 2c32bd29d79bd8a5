"""What C publishes of fingers: resultants by their definition, and the linear field from which `now` starts.

A resultant's deviation is √(g Σ g'), with the slope g of the resultant by finite differences of its definition. The
field of a finger and its slope are the product's, which test_several.py judges.
"""

from __future__ import annotations

import numpy as np
import pytest
from several_world import fingers_of, measured_of, models_of

from fmfts.several import _several
from fmfts.several.count import resultant
from fmfts.several.fit import Fitter
from oracle.field import Array

LIGHT_N, STEP = 0.2, 1e-6


def whole_of(fingers: Array) -> Array:
    force = fingers[:, 2].sum()
    return np.array([*(fingers[:, :2].T @ fingers[:, 2] / force), force])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_resultant_and_deviations_follow_their_definition(count: int) -> None:
    random = np.random.default_rng(count)
    for trial in range(40):
        fingers = np.column_stack([random.uniform(-12.0, 12.0, (count, 2)), random.uniform(0.1, 2.0, count)])
        root = random.normal(0.0, 0.1, (3 * count, 3 * count))
        covariance = root @ root.T
        slope = np.empty((3, 3 * count))
        for number in range(3 * count):
            step = np.zeros(3 * count)
            step[number] = STEP
            ahead, behind = (whole_of(fingers + sign * step.reshape(-1, 3)) for sign in (1.0, -1.0))
            slope[:, number] = (ahead - behind) / (2.0 * STEP)
        variance = np.vstack([np.diag(slope @ covariance @ slope.T), np.diag(covariance).reshape(-1, 3)])
        least = random.uniform(0.0, 2.0, variance.shape) * variance if trial % 2 else None
        deviation = np.empty((1 + count, 3))
        _several.resultant(fingers, np.empty(3), covariance, least, deviation)
        np.testing.assert_allclose(resultant(fingers), whole_of(fingers), rtol=1e-12)
        expected = variance if least is None else np.maximum(variance, least)
        np.testing.assert_allclose(deviation, np.sqrt(expected), rtol=1e-6)


@pytest.mark.parametrize("has_moved", [False, True])
def test_linear_field_of_a_followed_finger_is_its_field_and_slope(has_moved: bool) -> None:
    """At the fit's finger: the measured field without noise. Elsewhere: the model's, and the misfit as far as it is
    neither noise nor the ambient field, in proportion to the force."""
    fitter, random = Fitter(models_of(3, knots=15, terms=1)), np.random.default_rng(3)
    model, moment = fitter.model, 0.97
    rest_t = random.normal(0.0, 1e-5, len(model.at_rest))
    for _ in range(10):
        (true,) = fingers_of(random, 1)
        measured = measured_of(random, model, true[None])
        fit = fitter.fit(true[None], measured, np.zeros(3))
        found, ambient_t = fit.fingers[0], model.by_ambient @ fit.ambient_t
        there = fit.fingers if not has_moved else found + np.array([0.4, -0.3, 0.25])
        wrong_t = fit.misfit_t - fit.noise_t - ambient_t
        per_n = wrong_t * found[2] / (found[2] ** 2 + LIGHT_N**2)

        predicted = model.predict(np.reshape(there, (1, 3)))
        force_n = float(np.ravel(there)[2])
        field_t = predicted.field_t + ambient_t + wrong_t + per_n * (force_n - found[2])
        slope_t = predicted.slope + per_n[:, None] * [0.0, 0.0, 1.0]
        ahead, by_finger = np.empty(len(rest_t)), np.empty((len(rest_t), 3))
        given = fit.fingers, measured.field_t, fit.noise_t, fit.misfit_t, fit.slope_t, fit.ambient_t, rest_t, there
        _several.ahead(model.packed, model.work, *given, np.array([moment, LIGHT_N]), ahead, by_finger)
        size_t = np.abs(measured.field_t).max()
        np.testing.assert_allclose(ahead, moment * (rest_t + field_t), rtol=1e-9, atol=1e-9 * size_t)
        np.testing.assert_allclose(by_finger, moment * slope_t, rtol=1e-9, atol=1e-9 * size_t)
