"""The compiled search for fingers: what it refuses, what it takes of equals, and that its constants reach it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from several_world import SCENE, fingers_of, measured_of, models_of, mounting_of, pad_of, response_of

from fmfts.arithmetic.matrix import SingularError
from fmfts.several import fit
from fmfts.several.field_model import FieldModel
from fmfts.several.fit import Fit, Fitter, Measured
from fmfts.several.poses import poses_of

USUAL = (4, 8, 48, 15, 1)  # magnets, sensors, causes, knots, terms


NONE = np.zeros(3)


def of_fit(one: Fit) -> list[list[float]]:
    return [np.ravel(each).tolist() for each in (one.fingers, one.covariance, one.chi2, one.misfit_t)]


@cache
def fitter_of(*sizes: int) -> Fitter:
    return Fitter(models_of(1, *sizes))


def test_finger_with_nan_is_refused_by_name() -> None:
    model = models_of(1)
    with pytest.raises(ValueError, match="fingers: number 4 is nan"):
        model.predict(np.array([[0.0, 0.0, 1.0], [0.0, np.nan, 1.0]]))


@pytest.mark.parametrize(
    ("sizes", "what"),
    [
        ((10, 8, 4, 6, 1), "9 magnets, and this one has 10"),
        ((4, 17, 4, 6, 1), "16 sensors, and this one has 17"),
        ((4, 8, 97, 6, 1), "96 causes, and this one has 97"),
        ((4, 8, 4, 6, 9), "8 terms, and this one has 9"),
    ],
)
def test_pad_that_is_too_large_is_refused(sizes: tuple[int, ...], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        models_of(3, *sizes)


def test_more_fingers_than_there_is_room_for_are_refused() -> None:
    fitter, four = fitter_of(*USUAL), fingers_of(np.random.default_rng(5), 4)
    measured = measured_of(np.random.default_rng(18), fitter.model, four[:3])
    root = fitter.whitener(four[:3], measured, NONE)
    for refused in (
        lambda: fitter.model.predict(four),
        lambda: fitter.fit(four, measured, NONE),
        lambda: fitter.whitener(four, measured, NONE),
        lambda: fitter.chi2_with(root, four, measured),
    ):
        with pytest.raises(ValueError, match="3 fingers, and this one has 4"):
            refused()


def test_grid_that_is_too_large_is_refused() -> None:
    with pytest.raises(ValueError, match="961 places, and this one has 1089"):
        Fitter(models_of(1, reach_mm=32.0))


def test_non_finite_poses_are_refused_by_name() -> None:
    fitter, finger = fitter_of(*USUAL), np.array([[1.0, 2.0, 1.0]])
    good = measured_of(np.random.default_rng(16), fitter.model, finger)
    fit = fitter.fit(finger, good, NONE)
    broken = replace(good, variance_t2=np.where(np.arange(24) == 7, np.inf, good.variance_t2))
    negative = replace(good, variance_t2=good.variance_t2 - 1.0)
    for name, refused in {
        "fingers: number 0 is nan": lambda: poses_of(fitter, replace(fit, fingers=finger * np.nan), good, NONE),
        "ambient_t: number 0 is nan": lambda: poses_of(fitter, fit, good, NONE + np.nan),
        "variance_t2: number 7 is inf": lambda: poses_of(fitter, fit, broken, NONE),
        "24 × 24 is not positive definite": lambda: poses_of(fitter, fit, negative, NONE),
    }.items():
        with pytest.raises(ValueError, match=name):
            refused()


def uniform_along_x() -> Fitter:
    """Where a press does the same wherever it is along x: all places of a row gain the same to the last bit."""
    random = np.random.default_rng(9)
    pad = pad_of(random, 4, 8)
    response, mounting = response_of(random, pad, 15, 1), mounting_of(random, pad, 6)
    first = np.broadcast_to(response.coefficient[:1], response.coefficient.shape).copy()
    first[:, :, :, 2] *= 1.0 + 0.1 * np.arange(first.shape[1])[None, :, None]
    response = replace(response, coefficient=first)
    return Fitter(FieldModel(pad, mounting, response, SCENE))


def test_first_of_equal_places_is_chosen() -> None:
    fitter = uniform_along_x()
    random = np.random.default_rng(10)
    measured = measured_of(random, fitter.model, np.array([[0.0, -9.0, 1.0], [0.0, 8.0, 1.0]]))
    root = fitter.whitener(np.empty((0, 3)), measured, NONE)
    pairs = fitter.best_pairs(root, measured, 8)
    assert len(pairs) == 8
    assert fitter.best_single(root, measured)[0][0, 0] == -14.0
    assert pairs[0][:, 0].tolist() == [-14.0, -14.0]


def test_fingers_are_found_where_they_press() -> None:
    """Two fingers 16 mm apart, from nothing: scan, three fits, and the best of them."""
    fitter = fitter_of(*USUAL)
    true = np.array([[-8.0, -3.0, 1.0], [7.0, 2.0, 0.8]])
    measured = measured_of(np.random.default_rng(11), fitter.model, true, ambient_t=0.0)
    root = fitter.whitener(np.empty((0, 3)), measured, NONE)
    fits = [fitter.fit(start, measured, NONE) for start in fitter.best_pairs(root, measured)]
    best = min(fits, key=lambda one: one.chi2)
    order = np.argsort(best.fingers[:, 0])
    assert (np.abs(best.fingers[order] - true) < 5.0 * best.deviation[order]).all()
    assert best.deviation.max() < 1.0
    assert best.chi2 < 60.0


def test_search_ends_at_the_tables_edge_and_at_its_largest_force() -> None:
    fitter = fitter_of(*USUAL)
    measured = measured_of(np.random.default_rng(12), fitter.model, np.array([[13.9, 13.9, 20.0]]))
    found = fitter.fit(np.array([[1e6, 40.0, 1e300]]), measured, NONE).fingers
    assert (found <= [14.0, 14.0, 9.0]).all()
    assert (found >= [-14.0, -14.0, 0.0]).all()
    assert found[0, 2] == 9.0


@pytest.mark.parametrize("fingers", [0, 1, 2, 3])
def test_no_values_give_no_finger(fingers: int) -> None:
    fitter = fitter_of(*USUAL)
    nothing = Measured(np.full(24, np.nan), np.full(24, np.nan), np.zeros(24, bool))
    start = fingers_of(np.random.default_rng(13), fingers)
    there = fitter.fit(start, nothing, NONE)
    assert np.array_equal(there.fingers, start)
    assert np.diag(there.covariance) == pytest.approx(np.tile(1.0 / fit.FLOOR, fingers))
    assert there.chi2 == 0.0
    root = fitter.whitener(start, nothing, NONE)
    assert root.shape == (0, 0)
    place, gain = fitter.best_single(root, nothing)
    assert (place[0, 2], gain) == (0.0, 0.0)
    assert fitter.best_pairs(root, nothing) == []
    assert fitter.chi2_with(root, start, nothing) == 0.0


def test_number_that_is_not_finite_is_refused_by_name() -> None:
    fitter, finger = fitter_of(*USUAL), np.array([[1.0, 2.0, 1.0]])
    good = measured_of(np.random.default_rng(14), fitter.model, finger)
    root = fitter.whitener(finger, good, NONE)
    damaged = good.field_t.copy()
    damaged[5] = np.nan
    without = replace(good, field_t=damaged)
    for refused in (
        lambda: fitter.fit(finger, without, NONE),
        lambda: fitter.chi2_with(root, finger, without),
        lambda: fitter.best_single(root, without),
        lambda: fitter.best_pairs(root, without),
    ):
        with pytest.raises(ValueError, match="field_t: number 5 is nan"):
            refused()
    broken = replace(good, variance_t2=np.where(np.arange(24) == 7, np.inf, good.variance_t2))
    for refused in (lambda: fitter.fit(finger, broken, NONE), lambda: fitter.whitener(finger, broken, NONE)):
        with pytest.raises(ValueError, match="variance_t2: number 7 is inf"):
            refused()
    nowhere, whole = finger * np.nan, np.full_like(root, np.nan)
    for name, refused in {
        "start": lambda: fitter.fit(nowhere, good, NONE),
        "ambient_t": lambda: fitter.fit(finger, good, NONE + np.nan),
        "fingers": lambda: fitter.chi2_with(root, nowhere, good),
        "root": lambda: fitter.best_pairs(whole, good),
    }.items():
        with pytest.raises(ValueError, match=f"{name}: number 0 is nan"):
            refused()
    with pytest.raises(ValueError, match="fingers: number 0 is nan"):
        fitter.whitener(nowhere, good, NONE)
    with pytest.raises(ValueError, match="root: number 0 is nan"):
        fitter.chi2_with(whole, finger, good)
    with pytest.raises(ValueError, match="root: number 0 is nan"):
        fitter.best_single(whole, good)


def test_unsolvable_press_is_refused_with_the_reason() -> None:
    fitter, finger = fitter_of(*USUAL), np.array([[1.0, 2.0, 1.0]])
    good = measured_of(np.random.default_rng(15), fitter.model, finger)
    impossible = replace(good, variance_t2=-np.ones(24))
    for refused in (lambda: fitter.fit(finger, impossible, NONE), lambda: fitter.whitener(finger, impossible, NONE)):
        with pytest.raises(SingularError, match="a matrix of 24 × 24 is not positive definite"):
            refused()
    endless = np.array([1e300, 0.0, 0.0])
    with pytest.raises(SingularError, match="a matrix of 24 × 24 is not finite"), np.errstate(all="ignore"):
        fitter.fit(finger, good, endless)
    far = replace(good, field_t=np.full(24, 1e306))
    with pytest.raises(SingularError, match="a matrix of 3 × 3 is not finite"), np.errstate(all="ignore"):
        fitter.fit(finger, far, NONE)


@pytest.mark.parametrize(
    ("constant", "other"),
    [
        ("ITERATIONS", 3),
        ("SETTLED", 10.0),
        ("ROUNDING", -0.9),  # a step must lower χ² to a tenth
        ("DAMPING", 0.1),
        ("DAMPING_FACTOR", 3.0),
        ("MOST_DAMPING", 1e-5),  # the first refused step ends the search
        ("LONGEST_STEP_MM", 0.5),
        ("LEAST_STEP_MM", 100.0),
        ("FLOOR", np.array([1.0, 10.0, 100.0])),
        ("FARTHEST_LOAD", 0.1),
    ],
)
def test_each_constant_of_the_search_reaches_c(monkeypatch: pytest.MonkeyPatch, constant: str, other: object) -> None:
    usual, random = fitter_of(*USUAL), np.random.default_rng(20)
    true = np.array([[-8.0, -3.0, 1.0], [7.0, 2.0, 0.8]])
    measured = measured_of(random, usual.model, true)
    starts = [true + random.normal(0.0, [6.0, 6.0, 0.5], (2, 3)) for _ in range(12)]
    before = [of_fit(usual.fit(start, measured, NONE)) for start in starts]
    monkeypatch.setattr(fit, constant, other)
    assert [of_fit(Fitter(usual.model).fit(start, measured, NONE)) for start in starts] != before


def test_undetermined_finger_has_infinite_covariance(monkeypatch: pytest.MonkeyPatch) -> None:
    """One without force: where it is makes no difference."""
    monkeypatch.setattr(fit, "ITERATIONS", 0)
    monkeypatch.setattr(fit, "FLOOR", np.zeros(3))
    fitter = Fitter(fitter_of(*USUAL).model)
    start = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 1.0]])
    measured = measured_of(np.random.default_rng(21), fitter.model, start)
    assert np.isinf(fitter.fit(start, measured, NONE).covariance).all()


@pytest.mark.parametrize("values", [1, 2, 3])
def test_few_values_are_scanned(values: int) -> None:
    """One value tells no two places apart: a finger anywhere explains all of it."""
    fitter, random = fitter_of(*USUAL), np.random.default_rng(22)
    for trial in range(10):
        measured = measured_of(random, fitter.model, fingers_of(random, 2))
        measured = replace(measured, used=np.isin(np.arange(24), trial + 3 * np.arange(values)))
        root = fitter.whitener(np.empty((0, 3)), measured, NONE)
        white = np.linalg.solve(root, measured.field_t[measured.used])
        place, gain = fitter.best_single(root, measured)
        of_one_newton = fitter.model.predict(place * [1.0, 1.0, 1.0 / place[0, 2]]).field_t[measured.used]
        left = white - place[0, 2] * np.linalg.solve(root, of_one_newton)
        assert gain == pytest.approx(white @ white - left @ left, rel=1e-9)
        assert gain <= white @ white * (1.0 + 1e-12)
        assert values > 1 or gain == pytest.approx(white @ white, rel=1e-9)
        assert all(pair.shape == (2, 3) for pair in fitter.best_pairs(root, measured))


def test_scan_finds_each_pair_once() -> None:
    """The places 14 and 15 of a grid 15 wide are at its two ends, and C looks at four places at once."""
    fitter = fitter_of(*USUAL)
    ends = fitter.places[14:16]
    assert np.abs(ends[0] - ends[1]).max() > 20.0
    measured = measured_of(np.random.default_rng(23), fitter.model, ends, ambient_t=0.0)
    root = fitter.whitener(np.empty((0, 3)), measured, NONE)
    pairs = fitter.best_pairs(root, measured, 8)
    assert np.array_equal(pairs[0][:, :2], ends[:, :2])
    assert len({pair[:, :2].tobytes() for pair in pairs}) == len(pairs)


def test_arrays_of_another_pad_are_refused() -> None:
    fitter, other = fitter_of(*USUAL), fitter_of(3, 5, 7, 6, 2)
    finger = np.array([[1.0, 2.0, 1.0]])
    measured = measured_of(np.random.default_rng(16), other.model, finger)
    root = other.whitener(finger, measured, NONE)
    for refused in (
        lambda: fitter.fit(finger, measured, NONE),
        lambda: fitter.fit(finger[:, :2], measured, NONE),
        lambda: fitter.whitener(finger, measured, NONE),
        lambda: fitter.chi2_with(root, finger, measured),
        lambda: fitter.best_single(root, measured),
        lambda: fitter.best_pairs(root, measured),
        lambda: other.best_single(root[1:], measured),
        lambda: other.fit(finger, replace(measured, field_t=np.zeros(16)), NONE),
        lambda: other.fit(finger, replace(measured, variance_t2=np.ones(16)), NONE),
        lambda: other.fit(finger, replace(measured, used=np.ones(16, bool)), NONE),
        lambda: other.fit(finger, measured, np.zeros(2)),
        lambda: other.whitener(finger, replace(measured, variance_t2=np.ones(16)), NONE),
        lambda: other.whitener(finger, measured, np.zeros(2)),
        lambda: other.chi2_with(root, finger, replace(measured, field_t=np.zeros(16))),
        lambda: other.chi2_with(root[1:], finger, measured),
        lambda: other.best_pairs(root, replace(measured, field_t=np.zeros(16))),
    ):
        with pytest.raises(ValueError, match=r"array \d has \d+ bytes|another size"):
            refused()


def test_root_is_computed_anew_where_anything_in_it_has_changed() -> None:
    """A frame's fit, valley and poses share one root."""
    fitter, random = Fitter(models_of(1, *USUAL)), np.random.default_rng(21)
    fingers, ambient_t = fingers_of(random, 2), np.full(3, 3e-6)
    measured = measured_of(random, fitter.model, fingers)
    used = measured.used.copy()
    used[3:6] = False
    others = [
        (fingers[::-1], measured, ambient_t),
        (fingers[:1], measured, ambient_t),
        (fingers, replace(measured, variance_t2=2.0 * measured.variance_t2), ambient_t),
        (fingers, measured, -ambient_t),
        (fingers, measured.only(used), ambient_t),
        (fingers, measured.only(used[::-1]), ambient_t),
        (fingers, replace(measured, foreign_t2=1e-13 * np.eye(len(used))), ambient_t),
    ]
    for other in others:
        for case in ((fingers, measured, ambient_t), other, (fingers, measured, ambient_t)):
            anew = Fitter(models_of(1, *USUAL)).whitener(*case)
            np.testing.assert_array_equal(fitter.whitener(*case), anew)
            np.testing.assert_array_equal(fitter.whitener(*case), anew)


def test_flags_say_whether_fingers_are_doubtful_or_beyond_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fields of weak and strong fingers, inside and beside the table, near each other and apart."""
    monkeypatch.setattr(fit, "TOGETHER_MM", 12.0)  # nearer ones than 6.5 mm are also weak on this pad
    fitter, random, met = Fitter(models_of(1, *USUAL)), np.random.default_rng(23), set()
    response = fitter.model.response
    for trial in range(300):
        true = fingers_of(random, trial % 3, beyond=trial % 4 == 0)
        true[:, 2] *= random.choice([0.01, 0.1, 1.0])
        found = fitter.fit(true, measured_of(random, fitter.model, true), NONE)
        places, forces = found.fingers[:, :2], found.fingers[:, 2]
        weak = bool((forces < 3.0 * found.deviation[:, 2]).any())
        near = len(true) > 1 and bool(np.linalg.norm(places[0] - places[1]) < 12.0)
        inside = ((places > response.first_mm + 0.5) & (places < response.last_mm - 0.5)).all(axis=1)
        beyond = (forces > response.scale_n) | (forces > 6.0 * found.deviation[:, 2]) & ~inside
        wanted = fit.DOUBTFUL * (weak or near) + fit.BEYOND * bool(beyond.any())
        assert found.flags == wanted
        met.add((weak, near, bool((beyond & inside).any()), bool((beyond & ~inside).any())))
    assert all(any(each[which] for each in met) for which in range(4))
    assert (False, True, False, False) in met


def test_root_after_a_fit_is_that_of_its_fingers() -> None:
    fitter, random = Fitter(models_of(1, *USUAL)), np.random.default_rng(22)
    for count in (0, 1, 2):
        fingers = fingers_of(random, count)
        measured = measured_of(random, fitter.model, fingers)
        found = fitter.fit(fingers, measured, NONE)
        anew = Fitter(models_of(1, *USUAL)).whitener(found.fingers, measured, NONE)
        np.testing.assert_array_equal(fitter.whitener(found.fingers, measured, NONE), anew)
