"""The numbers between a frame and a message: right to the last bit and a little, and with one order of every sum."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path

import exp_tables
import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import fmfts.arithmetic
from fmfts.arithmetic import _arithmetic, elementary, matrix, series
from fmfts.pad import Array
from twins import matrix as in_order

# Rounding leaves half of a unit in the last place, Tang's table and Dekker's product up to 0.04 more.
IN_THE_LAST_PLACE = 0.54
# The value rounded once, where no argument of the thousand lies a billionth from a tie.
ROUNDED = 0.5 + 1e-9


def matrices(*shape: int) -> st.SearchStrategy[Array]:
    return arrays(np.float64, shape, elements=st.floats(-10.0, 10.0, width=32))


def in_units_of_the_last_place(value: float, exact: mpmath.mpf) -> float:
    return float(abs(mpmath.mpf(value) - exact) / math.ulp(float(exact)))


@pytest.mark.parametrize(
    ("function", "exact", "draw", "most"),
    [
        (elementary.exp, mpmath.exp, lambda r: r.uniform(-700.0, 700.0), IN_THE_LAST_PLACE),
        (elementary.exp, mpmath.exp, lambda r: r.gauss(0.0, 0.1), IN_THE_LAST_PLACE),
        (elementary.log, mpmath.log, lambda r: math.exp(r.uniform(-700.0, 700.0)), IN_THE_LAST_PLACE),
        (elementary.log, mpmath.log, lambda r: 1.0 + r.uniform(-0.3, 0.5), IN_THE_LAST_PLACE),
        (elementary.log, mpmath.log, lambda r: 1.0 + 10.0 ** r.uniform(-14.0, -1.0), IN_THE_LAST_PLACE),
        (series.sin, mpmath.sin, lambda r: r.uniform(-10.0, 10.0), ROUNDED),
        (series.cos, mpmath.cos, lambda r: r.uniform(-10.0, 10.0), ROUNDED),
        (series.erf, mpmath.erf, lambda r: r.uniform(-6.0, 6.0), ROUNDED),
        (series.erfc, mpmath.erfc, lambda r: r.uniform(-6.0, 26.0), ROUNDED),
    ],
)
def test_function_is_right_to_the_last_bit_and_a_little(
    function: Callable[[float], float],
    exact: Callable[[mpmath.mpf], mpmath.mpf],
    draw: Callable[[random.Random], float],
    most: float,
) -> None:
    chance = random.Random(1)
    with mpmath.workprec(300):
        for _ in range(1000):
            x = draw(chance)
            assert in_units_of_the_last_place(function(x), exact(mpmath.mpf(x))) <= most, x


@pytest.mark.parametrize(
    ("function", "x", "value"),
    [
        (elementary.exp, 0.0, 1.0),
        (elementary.exp, math.inf, math.inf),
        (elementary.exp, 709.8, math.inf),
        (elementary.exp, -math.inf, 0.0),
        (elementary.exp, -746.0, 0.0),
        (elementary.log, 1.0, 0.0),
        (elementary.log, 0.0, -math.inf),
        (elementary.log, math.inf, math.inf),
        (elementary.log, math.ulp(0.0), -744.4400719213812),
        (series.erfc, -40.0, 2.0),
        (series.erfc, 40.0, 0.0),
        (series.erf, -40.0, -1.0),
        (series.sin, 0.0, 0.0),
    ],
)
def test_ends_of_a_range(function: Callable[[float], float], x: float, value: float) -> None:
    assert function(x) == value


def test_missing_number_stays_null() -> None:
    assert math.isnan(elementary.exp(math.nan))
    assert math.isnan(elementary.log(math.nan))
    assert math.isnan(elementary.log(-1.0))
    with pytest.raises(ValueError, match="a finite number is needed, not nan"):
        series.sin(math.nan)


def test_table_of_c_is_that_of_python() -> None:
    made = Path(fmfts.arithmetic.__file__).with_name("tables.h").read_text()
    assert made == exp_tables.header(), "python tests/unit/exp_tables.py > daemon/fmfts/arithmetic/tables.h"


def test_table_of_exp_is_that_of_the_powers_of_two() -> None:
    with mpmath.workprec(200):
        for step, (high, low) in enumerate(exp_tables.POWERS_OF_TWO):
            exact = mpmath.mpf(2) ** (mpmath.mpf(step) / 32)
            assert abs(mpmath.mpf(high) + mpmath.mpf(low) - exact) < 2.0**-106
        assert abs(mpmath.mpf(exp_tables.LN2_HIGH) + mpmath.mpf(exp_tables.LN2_LOW) - mpmath.log(2)) < 2.0**-90


@given(matrices(2, 3, 4), matrices(2, 4, 5), matrices(3, 4))
def test_product_adds_in_its_order(a: Array, b: Array, one: Array) -> None:
    assert np.array_equal(matrix.product(a, b), in_order.product(a, b))
    assert np.array_equal(matrix.product(one, b), in_order.product(one, b))


@given(matrices(6, 6), matrices(6, 2))
def test_equations_are_solved_in_their_order(root: Array, right: Array) -> None:
    a = in_order.product(root, root.T) + 1e-3 * np.eye(6)
    lower, ours = a.copy(), right.copy()
    assert in_order.cholesky(lower)
    assert np.array_equal(matrix.cholesky(a), lower)
    in_order.solve_lower(lower, ours)
    in_order.solve_lower_transposed(lower, ours)
    assert np.array_equal(matrix.solve(a, right), ours)


@given(matrices(7, 4))
def test_jacobi_rotates_columns_in_a_fixed_order(a: Array) -> None:
    ours, right = a.copy(), np.empty((4, 4))
    theirs, turned = a.copy(), np.empty((4, 4))
    assert in_order.rotate_columns(ours, right) == _arithmetic.rotate_columns(7, 4, theirs, turned)
    assert np.array_equal(ours, theirs)
    assert np.array_equal(right, turned)
    left, other = np.empty((7, 3)), np.empty((7, 3))
    in_order.complement(a.copy(), left)
    _arithmetic.complement(7, 4, a.copy(), other)
    assert np.array_equal(left, other)


@pytest.mark.parametrize(
    ("left", "right"),
    [((3,), (3,)), ((2, 3), (3,)), ((3,), (3, 2)), ((2, 3), (3, 4)), ((5, 2, 3), (3, 4)), ((2, 3), (5, 3, 4)),
     ((5, 2, 3), (5, 3, 1)), ((5, 1, 2, 3), (4, 3, 2)), ((5, 2, 3), (3,)), ((3, 0), (0, 2)), ((0, 2, 3), (3, 4))],
)  # fmt: skip
def test_product_has_the_shapes_of_numpy(left: tuple[int, ...], right: tuple[int, ...]) -> None:
    random = np.random.default_rng(0)
    a, b = random.normal(size=left), random.normal(size=right)
    expected, found = a @ b, matrix.product(a, b)
    assert np.shape(found) == np.shape(expected)
    # Two orders of a sum of three products of numbers about one.
    assert np.abs(found - expected).max(initial=0.0) < 1e-14


def test_product_of_matrices_that_do_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"cannot multiply \(2, 3\) by \(2, 3\)"):
        matrix.product(np.zeros((2, 3)), np.zeros((2, 3)))


def well_conditioned(*shape: int) -> Array:
    return np.random.default_rng(7).normal(size=shape)


# Sums of ten numbers about one, of a matrix whose condition is about ten: a hundred roundings.
CLOSE = 1e-13


def test_algebra_agrees_with_lapack() -> None:
    root = well_conditioned(3, 6, 9)
    a, right = root @ root.swapaxes(1, 2), well_conditioned(3, 6, 2)
    assert np.abs(matrix.cholesky(a) - np.linalg.cholesky(a)).max() < CLOSE
    assert np.abs(matrix.solve(a, right) - np.linalg.solve(a, right)).max() < CLOSE * 10
    assert np.abs(matrix.solve(a[0], right[0, :, 0]) - np.linalg.solve(a[0], right[0, :, 0])).max() < CLOSE * 10
    assert np.abs(matrix.inverse(a) - np.linalg.inv(a)).max() < CLOSE * 10
    assert matrix.log_determinant(a[0]) == pytest.approx(np.linalg.slogdet(a[0])[1], rel=CLOSE)
    left, values, turned = matrix.singular_values(root[0].T)
    assert np.abs(left * values @ turned.T - root[0].T).max() < CLOSE
    assert values == pytest.approx(np.linalg.svd(root[0])[1], rel=CLOSE)
    eigenvalues, vectors = matrix.eigen(a[0])
    assert eigenvalues == pytest.approx(np.linalg.eigvalsh(a[0]), rel=CLOSE)
    assert np.abs(a[0] @ vectors - vectors * eigenvalues).max() < CLOSE * 100
    aside = matrix.complement(root[0].T)
    assert np.abs(aside.T @ root[0].T).max() < CLOSE
    assert np.abs(aside.T @ aside - np.eye(3)).max() < CLOSE


@pytest.mark.parametrize("rank", [4, 3, 1, 0])
def test_least_squares_is_the_shortest_of_the_best(rank: int) -> None:
    a = well_conditioned(7, rank) @ well_conditioned(rank, 4)
    right = well_conditioned(7, 2)
    expected = np.linalg.lstsq(a, right, rcond=None)[0]
    assert np.abs(matrix.least_squares(a, right) - expected).max() < CLOSE * 10
    assert np.abs(matrix.least_squares(a, right[:, 0]) - expected[:, 0]).max() < CLOSE * 10


def test_negative_eigenvalues_are_returned() -> None:
    values, _ = matrix.eigen(np.diag([2.0, -1.0, 0.5]))
    assert values.tolist() == [-1.0, 0.5, 2.0]


@pytest.mark.parametrize("bad", [[[1.0, 2.0], [2.0, 1.0]], [[math.nan, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 0.0]]])
def test_indefinite_matrix_is_refused(bad: list[list[float]]) -> None:
    for ask in (matrix.cholesky, matrix.inverse, matrix.log_determinant):
        with pytest.raises(matrix.SingularError):
            ask(np.array(bad))


def test_non_finite_matrix_has_no_singular_values() -> None:
    with pytest.raises(matrix.SingularError):
        matrix.singular_values(np.array([[math.nan, 1.0], [1.0, 1.0]]))


def test_lengths_are_those_of_numpy() -> None:
    vectors = well_conditioned(5, 3)
    assert matrix.length(vectors[0]) == pytest.approx(float(np.linalg.norm(vectors[0])), rel=CLOSE)
    assert matrix.lengths(vectors) == pytest.approx(np.linalg.norm(vectors, axis=1), rel=CLOSE)
    assert matrix.root_of_squares(3.0, 4.0) == 5.0


@pytest.mark.parametrize(
    "shape", [(2, 3), (2, 5), (3, 4), (9, 8), (6, 6), (20, 20)], ids=lambda shape: f"{shape[0]} × {shape[1]}"
)
@pytest.mark.parametrize("rank", [1, 2])
def test_singular_values_are_found_of_any_shape_and_rank(shape: tuple[int, int], rank: int) -> None:
    """Columns of mere rounding are not rotated for ever."""
    random = np.random.default_rng(3)
    for _ in range(100):
        a = random.normal(size=(shape[0], rank)) @ random.normal(size=(rank, shape[1]))
        assert matrix.singular_values(a)[1][:rank] == pytest.approx(np.linalg.svd(a)[1][:rank], rel=1e-9)


def test_eigenvalues_that_differ_in_their_sign_alone_are_refused() -> None:
    with pytest.raises(ValueError, match="differ only in their sign"):
        matrix.eigen(np.array([[0.0, 1.0], [1.0, 0.0]]))


@pytest.mark.parametrize(
    ("lower", "right"), [((3, 3), (2, 3)), ((3, 3), (2, 3, 2)), ((4, 3, 3), (3, 2)), ((3, 3), (2,))]
)
def test_equations_that_do_not_fit_are_refused(lower: tuple[int, ...], right: tuple[int, ...]) -> None:
    triangle = np.broadcast_to(np.eye(lower[-1]), lower)
    with pytest.raises(ValueError, match="equations of"):
        matrix.solve(triangle, np.ones(right))
