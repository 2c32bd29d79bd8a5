"""The C of several/ against its NumPy: the same bits, for every pad and every finger."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from several_world import SCENE, fingers_of, measured_of, models_of, mounting_of, pad_of, response_of

from fmfts.arithmetic.matrix import SingularError
from fmfts.several import fit
from fmfts.several.field_model import FieldModel, Predicted
from fmfts.several.fit import STARTS, Fit, Fitter, Measured
from fmfts.several.poses import Poses, poses_of
from fmfts.several.valley import fitted_across
from twins.several import NumPyFitter, NumPyModel
from twins.several_poses import across_in_numpy, poses_in_numpy

# Magnets, sensors, causes, knots, terms: the usual pad, the least, the most, and sizes that fill no register.
PADS = [(4, 8, 48, 15, 1), (1, 2, 1, 4, 3), (9, 16, 96, 12, 8), (3, 5, 7, 6, 2), (2, 7, 0, 31, 2)]


def bits(*arrays: np.ndarray | float) -> list[bytes]:
    return [np.ascontiguousarray(array, float).tobytes() for array in arrays]


def of_predicted(one: Predicted) -> list[bytes]:
    return bits(*one[:4], *(part for pressed in one.pressed for part in pressed))


NONE = np.zeros(3)


def of_fit(one: Fit) -> list[bytes]:
    return bits(one.fingers, one.covariance, one.chi2, one.misfit_t, one.ambient_t, one.shear_n, one.shear_deviation_n)


@cache
def fitters_of(*sizes: float) -> tuple[Fitter, Fitter]:
    """In C, and in NumPy."""
    model, reference = models_of(1, *sizes)  # type: ignore[arg-type]
    return Fitter(model), NumPyFitter(reference)


def masked(random: np.random.Generator, measured: Measured, trial: int) -> Measured:
    """All values, without some sensors, without single values; what there is not is NaN."""
    used = np.ones(len(measured.used), bool)
    if trial % 3 == 1:
        used = np.repeat(random.uniform(size=len(used) // 3) < 0.8, 3)
    elif trial % 3 == 2:
        used = random.uniform(size=len(used)) < 0.6
    variance = measured.variance_t2 * random.uniform(0.5, 2.0, len(used))
    root = 3e-7 * random.standard_normal((len(used), 6))  # of neighbouring pads, in every other trial
    foreign = root @ root.T if trial % 2 else None
    return Measured(np.where(used, measured.field_t, np.nan), np.where(used, variance, np.nan), used, foreign)


@pytest.mark.parametrize("sizes", PADS)
@pytest.mark.parametrize("beyond", [False, True], ids=["on the table", "beyond it"])
def test_field_and_its_covariance_have_the_same_bits_in_c(sizes: tuple[int, ...], beyond: bool) -> None:
    model, reference = models_of(1, *sizes)
    random = np.random.default_rng(2)
    for trial in range(20):
        fingers = fingers_of(random, trial % 4, beyond)
        there, here = model.predict(fingers), reference.predict(fingers)
        assert of_predicted(there) == of_predicted(here)
        assert [part.shape for part in there[:4]] == [part.shape for part in here[:4]]
        variance, ambient = random.uniform(0.5e-14, 2e-14, len(here.field_t)), random.normal(0.0, 2e-5, 3)
        covariance = [one.covariance(fingers, here, variance, ambient) for one in (model, reference)]
        assert bits(covariance[0]) == bits(covariance[1])


@pytest.mark.parametrize("which", [0, 1], ids=["compiled", "NumPy"])
def test_finger_that_is_no_number_is_refused_by_name(which: int) -> None:
    model = models_of(1)[which]
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
    fitter, four = fitters_of(4, 8, 48, 15, 1)[0], fingers_of(np.random.default_rng(5), 4)
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
        Fitter(models_of(1, reach_mm=32.0)[0])


@pytest.mark.parametrize("sizes", PADS)
@pytest.mark.parametrize("beyond", [False, True], ids=["on the table", "beyond it"])
def test_fit_has_the_same_bits_in_c(sizes: tuple[int, ...], beyond: bool) -> None:
    fitter, reference = fitters_of(*sizes)
    random = np.random.default_rng(6)
    for trial in range(24):
        true, start = fingers_of(random, trial % 4), fingers_of(random, trial // 4 % 4, beyond)
        measured = masked(random, measured_of(random, reference.model, true), trial)
        ambient = random.normal(0.0, 2e-5, 3)
        few_iterations = bool(trial // 3 % 2)
        there, here = (one.fit(start, measured, ambient, few_iterations) for one in (fitter, reference))
        assert of_fit(there) == of_fit(here)
        assert there.fingers.shape == start.shape
        assert there.covariance.shape == here.covariance.shape


@pytest.mark.parametrize("sizes", PADS)
def test_covariance_root_and_chi2_have_the_same_bits_in_c(sizes: tuple[int, ...]) -> None:
    fitter, reference = fitters_of(*sizes)
    random = np.random.default_rng(7)
    for trial in range(24):
        true, fingers = fingers_of(random, trial % 4), fingers_of(random, trial // 4 % 4)
        measured = masked(random, measured_of(random, reference.model, true), trial)
        ambient = random.normal(0.0, 2e-5, 3)
        there, here = (one.whitener(fingers, measured, ambient) for one in (fitter, reference))
        assert there.shape == (measured.used.sum(),) * 2
        assert bits(there) == bits(here)
        assert fitter.chi2_with(here, true, measured) == reference.chi2_with(here, true, measured)


@pytest.mark.parametrize("sizes", [*PADS, (9, 16, 64, 12, 8, 30.0)])
def test_scan_finds_the_same_places_with_the_same_bits_in_c(sizes: tuple[float, ...]) -> None:
    fitter, reference = fitters_of(*sizes)
    random = np.random.default_rng(8)
    found = 0
    for trial in range(12 if len(sizes) == 5 else 3):
        measured = masked(random, measured_of(random, reference.model, fingers_of(random, 2)), trial)
        root = reference.whitener(fingers_of(random, trial % 3), measured, NONE)
        (there, gain), (here, due) = (one.best_single(root, measured) for one in (fitter, reference))
        assert bits(there, gain) == bits(here, due)
        for most in (1, STARTS, 8):
            pairs, wanted = (one.best_pairs(root, measured, most) for one in (fitter, reference))
            assert bits(*pairs) == bits(*wanted)
            assert all(pair.shape == (2, 3) for pair in pairs)
        found += len(wanted)
    assert found > 5, "there was nothing to compare"


@pytest.mark.parametrize("sizes", [*PADS, (9, 16, 64, 12, 8, 30.0)])
def test_one_more_finger_is_tried_everywhere_with_the_same_bits_in_c(sizes: tuple[float, ...]) -> None:
    fitter, reference = fitters_of(*sizes)
    random = np.random.default_rng(12)
    gained = 0
    for trial in range(12 if len(sizes) == 5 else 3):
        measured = masked(random, measured_of(random, reference.model, fingers_of(random, 2)), trial)
        told = fingers_of(random, trial % 4)
        fit = replace(reference.fit(told[:1], measured, NONE), fingers=told)
        root = reference.whitener(told, measured, NONE)
        there, here = (one.another(root, fit, measured) for one in (fitter, reference))
        assert bits(*there) == bits(*here)
        assert there.by_force.shape == here.by_force.shape == (3 * len(told), len(here.places))
        gained += int((here.gain > 0.0).sum())
        if len(told) == 1:
            pairs, wanted = (one.best_seconds(root, fit, measured) for one in (fitter, reference))
            assert bits(*pairs) == bits(*wanted)
    assert gained > 20, "there was nothing to compare"


@pytest.mark.parametrize("sizes", PADS)
def test_fingers_put_elsewhere_have_the_same_bits_in_c(sizes: tuple[int, ...]) -> None:
    fitter, reference = fitters_of(*sizes)
    random = np.random.default_rng(13)
    reached = refused = 0
    for trial in range(24):
        count = 1 + trial % 3
        measured = masked(random, measured_of(random, reference.model, fingers_of(random, count)), trial)
        told = replace(reference.fit(fingers_of(random, count), measured, NONE), fingers=fingers_of(random, count))
        directions = np.zeros((1 + trial % 2, 3 * count))
        directions[:, :2] = random.normal(0.0, 1.0, (len(directions), 2))
        directions *= trial < 22  # without a direction no step leads anywhere
        away = random.normal(0.0, 3.0, directions.shape)
        with np.errstate(invalid="ignore"):
            there, here = (one_across(one, told, away, directions, measured) for one in (fitter, reference))
        assert bits(*there) == bits(*here)
        reached += int(np.isfinite(here[1]).sum())
        refused += int(np.isinf(here[1]).sum())
    assert reached > 20, "there was nothing to compare"
    assert refused


def one_across(
    fitter: Fitter, told: Fit, away: np.ndarray, directions: np.ndarray, measured: Measured
) -> tuple[np.ndarray, np.ndarray]:
    across = across_in_numpy if isinstance(fitter, NumPyFitter) else fitted_across
    there, chi2 = across(fitter, told, away, directions, measured, np.full(3, 1e-5))
    assert there.shape == (len(away), 2, *told.fingers.shape)
    return np.where(np.isfinite(chi2)[..., None, None], there, 0.0), chi2


def of_poses(one: Poses) -> list[bytes]:
    return bits(one.magnets.position_m, one.magnets.axis, *one[1:], one.covariance)


@pytest.mark.parametrize("sizes", PADS)
@pytest.mark.parametrize("beyond", [False, True], ids=["on the table", "beyond it"])
def test_poses_of_the_magnets_have_the_same_bits_in_c(sizes: tuple[int, ...], beyond: bool) -> None:
    fitter, reference = fitters_of(*sizes)
    random = np.random.default_rng(15)
    told = 0
    for trial in range(24):
        fingers = fingers_of(random, trial % 4, beyond)
        measured = masked(random, measured_of(random, reference.model, fingers), trial)
        ambient = random.normal(0.0, 2e-5, 3)
        fit = replace(reference.fit(fingers, measured, ambient), fingers=fingers)
        there, here = (
            one(each, fit, measured, ambient) for one, each in ((poses_of, fitter), (poses_in_numpy, reference))
        )
        assert of_poses(there) == of_poses(here)
        assert [part.shape for part in there[1:]] == [part.shape for part in here[1:]]
        assert bits(there.magnets.strength_t_m3, there.magnets.octupole_m2) == bits(*mount_of(reference))
        # The variance is the covariance's diagonal, but for the rounding of what is subtracted.
        rounding = 1e-13 * (np.square(here.moves).sum(axis=1) + here.variance)
        assert (np.abs(there.variance - np.diagonal(there.covariance)) <= rounding).all()
        told += int((here.told != 0.0).sum())
    assert told > 100, "there was nothing to compare"


def mount_of(fitter: Fitter) -> tuple[np.ndarray, np.ndarray]:
    magnets = fitter.model.mounting.magnets
    return magnets.strength_t_m3, magnets.octupole_m2


@pytest.mark.parametrize("which", [0, 1], ids=["compiled", "NumPy"])
def test_poses_of_what_is_not_finite_are_refused_by_name(which: int) -> None:
    fitter, finger = fitters_of(4, 8, 48, 15, 1)[which], np.array([[1.0, 2.0, 1.0]])
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


def uniform_along_x() -> tuple[Fitter, Fitter]:
    """Where a press does the same wherever it is along x: all places of a row gain the same to the last bit."""
    random = np.random.default_rng(9)
    pad = pad_of(random, 4, 8)
    response, mounting = response_of(random, pad, 15, 1), mounting_of(random, pad, 6)
    first = np.broadcast_to(response.coefficient[:1], response.coefficient.shape).copy()
    first[:, :, :, 2] *= 1.0 + 0.1 * np.arange(first.shape[1])[None, :, None]
    response = replace(response, coefficient=first)
    return (
        Fitter(FieldModel(pad, mounting, response, SCENE)),
        NumPyFitter(NumPyModel(pad, mounting, response, SCENE)),
    )


def test_of_pairs_that_are_equally_good_c_takes_the_first_as_numpy_does() -> None:
    fitter, reference = uniform_along_x()
    random = np.random.default_rng(10)
    measured = measured_of(random, reference.model, np.array([[0.0, -9.0, 1.0], [0.0, 8.0, 1.0]]))
    root = reference.whitener(np.empty((0, 3)), measured, NONE)
    assert bits(*fitter.best_single(root, measured)) == bits(*reference.best_single(root, measured))
    pairs, wanted = (one.best_pairs(root, measured, 8) for one in (fitter, reference))
    assert len(wanted) == 8
    assert bits(*pairs) == bits(*wanted)
    assert fitter.best_single(root, measured)[0][0, 0] == -14.0


@pytest.mark.parametrize("which", [0, 1], ids=["compiled", "NumPy"])
def test_fingers_are_found_where_they_press(which: int) -> None:
    """Two fingers 16 mm apart, from nothing: scan, three fits, and the best of them."""
    fitter = fitters_of(4, 8, 48, 15, 1)[which]
    true = np.array([[-8.0, -3.0, 1.0], [7.0, 2.0, 0.8]])
    measured = measured_of(np.random.default_rng(11), fitter.model, true, ambient_t=0.0)
    root = fitter.whitener(np.empty((0, 3)), measured, NONE)
    fits = [fitter.fit(start, measured, NONE) for start in fitter.best_pairs(root, measured)]
    best = min(fits, key=lambda one: one.chi2)
    order = np.argsort(best.fingers[:, 0])
    assert (np.abs(best.fingers[order] - true) < 5.0 * best.deviation[order]).all()
    assert best.deviation.max() < 1.0
    assert best.chi2 < 60.0


@pytest.mark.parametrize("which", [0, 1], ids=["compiled", "NumPy"])
def test_search_ends_at_the_tables_edge_and_at_its_largest_force(which: int) -> None:
    fitter = fitters_of(4, 8, 48, 15, 1)[which]
    measured = measured_of(np.random.default_rng(12), fitter.model, np.array([[13.9, 13.9, 20.0]]))
    found = fitter.fit(np.array([[1e6, 40.0, 1e300]]), measured, NONE).fingers
    assert (found <= [14.0, 14.0, 9.0]).all()
    assert (found >= [-14.0, -14.0, 0.0]).all()
    assert found[0, 2] == 9.0


@pytest.mark.parametrize("fingers", [0, 1, 2, 3])
def test_without_any_value_c_tells_the_same_nothing(fingers: int) -> None:
    fitter, reference = fitters_of(4, 8, 48, 15, 1)
    nothing = Measured(np.full(24, np.nan), np.full(24, np.nan), np.zeros(24, bool))
    start = fingers_of(np.random.default_rng(13), fingers)
    there, here = (one.fit(start, nothing, NONE) for one in (fitter, reference))
    assert of_fit(there)[:3] == of_fit(here)[:3]
    assert bits(there.fingers) == bits(start)
    assert there.chi2 == 0.0
    root = fitter.whitener(start, nothing, NONE)
    assert root.shape == (0, 0)
    assert bits(*fitter.best_single(root, nothing)) == bits(*reference.best_single(root, nothing))
    assert fitter.best_pairs(root, nothing) == reference.best_pairs(root, nothing) == []
    assert fitter.chi2_with(root, start, nothing) == 0.0


@pytest.mark.parametrize("which", [0, 1], ids=["compiled", "NumPy"])
def test_number_that_is_not_finite_is_refused_by_name(which: int) -> None:
    fitter, finger = fitters_of(4, 8, 48, 15, 1)[which], np.array([[1.0, 2.0, 1.0]])
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


@pytest.mark.parametrize("which", [0, 1], ids=["compiled", "NumPy"])
def test_what_cannot_be_solved_is_refused_and_says_why(which: int) -> None:
    fitter, finger = fitters_of(4, 8, 48, 15, 1)[which], np.array([[1.0, 2.0, 1.0]])
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
        ("MOST_DAMPING", 1e-5),  # the first step that is refused ends the search
        ("LONGEST_STEP_MM", 0.5),
        ("LEAST_STEP_MM", 100.0),
        ("FLOOR", np.array([1.0, 10.0, 100.0])),
        ("FARTHEST_LOAD", 0.1),
    ],
)
def test_each_constant_of_the_search_is_the_same_in_c(
    monkeypatch: pytest.MonkeyPatch, constant: str, other: object
) -> None:
    fitter, usual = fitters_of(4, 8, 48, 15, 1)
    random = np.random.default_rng(20)
    true = np.array([[-8.0, -3.0, 1.0], [7.0, 2.0, 0.8]])
    measured = measured_of(random, usual.model, true)
    starts = [true + random.normal(0.0, [6.0, 6.0, 0.5], (2, 3)) for _ in range(12)]
    before = [of_fit(fitter.fit(start, measured, NONE)) for start in starts]
    monkeypatch.setattr(fit, constant, other)
    there, here = (
        [of_fit(type(one)(one.model).fit(start, measured, NONE)) for start in starts] for one in (fitter, usual)
    )
    assert there == here
    assert here != before


def test_finger_that_the_values_say_nothing_of_has_an_infinite_covariance(monkeypatch: pytest.MonkeyPatch) -> None:
    """One without force: where it is makes no difference."""
    monkeypatch.setattr(fit, "ITERATIONS", 0)
    monkeypatch.setattr(fit, "FLOOR", np.zeros(3))
    fitter, reference = (type(one)(one.model) for one in fitters_of(4, 8, 48, 15, 1))
    start = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 1.0]])
    measured = measured_of(np.random.default_rng(21), reference.model, start)
    there, here = (one.fit(start, measured, NONE) for one in (fitter, reference))
    assert of_fit(there) == of_fit(here)
    assert np.isinf(there.covariance).all()


@pytest.mark.parametrize("values", [1, 2, 3])
def test_few_values_are_scanned_with_the_same_bits_in_c(values: int) -> None:
    """One value tells no two places apart: only rounding does."""
    fitter, reference = fitters_of(4, 8, 48, 15, 1)
    random = np.random.default_rng(22)
    for trial in range(10):
        measured = measured_of(random, reference.model, fingers_of(random, 2))
        measured = replace(measured, used=np.isin(np.arange(24), trial + 3 * np.arange(values)))
        root = reference.whitener(np.empty((0, 3)), measured, NONE)
        assert bits(*fitter.best_single(root, measured)) == bits(*reference.best_single(root, measured))
        assert bits(*fitter.best_pairs(root, measured)) == bits(*reference.best_pairs(root, measured))


def test_no_pair_is_found_twice_where_a_block_of_c_holds_both_places() -> None:
    """The places 14 and 15 of a grid 15 wide are at its two ends, and C looks at four places at once."""
    fitter, reference = fitters_of(4, 8, 48, 15, 1)
    ends = reference.places[14:16]
    assert np.abs(ends[0] - ends[1]).max() > 20.0
    measured = measured_of(np.random.default_rng(23), reference.model, ends, ambient_t=0.0)
    root = reference.whitener(np.empty((0, 3)), measured, NONE)
    pairs, wanted = (one.best_pairs(root, measured, 8) for one in (fitter, reference))
    assert bits(*pairs) == bits(*wanted)
    assert bits(pairs[0][:, :2]) == bits(ends[:, :2])


def test_arrays_of_another_pad_are_refused() -> None:
    fitter, other = fitters_of(4, 8, 48, 15, 1)[0], fitters_of(3, 5, 7, 6, 2)[0]
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
