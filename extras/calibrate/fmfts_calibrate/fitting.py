"""Fits the smooth response of a pad to measured changes of pose, by penalised least squares on its coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.contact.response import CHANGE, Array, Indices, Response

# Powers of the normal force: three are exact to 0.01 mm up to 2 N, five up to 4 N. Forces that differ by less than
# LEVEL_SHARE of the largest are one level: a stage reaches a force to 5 % or worse, which shows no curvature.
NORMAL_POWERS, LEVEL_SHARE = 5, 0.15
# Exponents of (normal, shear x, shear y): linear in shear, otherwise on a squeezed pad, and quadratic.
SHEAR_EXPONENTS = (
    *((0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (2, 1, 0), (2, 0, 1)),
    *((0, 2, 0), (0, 1, 1), (0, 0, 2)),
)
# Weights of roughness, relative to that of the data: from "pass through every point" to "mostly noise".
ROUGHNESS = (1e-7, 1e-5, 1e-3, 1e-1)
MOST_CELLS, FEWEST_CELLS = 20, 4
FOLDS = 5


def fit_response(press: Array, change: Array, deviation: Array, roughness: float | None = None) -> Response:
    """A smooth response that explains `change` (K, 5) under presses (K, 2 + L) to within `deviation` (K, 5).

    roughness: weight of the penalty; None: `best_roughness`.
    """
    if roughness is None:
        roughness = best_roughness(press, change, deviation)
    return _solved(empty_response(press), press, change, deviation, roughness)


def best_roughness(press: Array, change: Array, deviation: Array) -> float:
    """The weight in ROUGHNESS that predicts left-out presses best, in five folds."""
    empty = empty_response(press)
    return min(ROUGHNESS, key=lambda weight: _left_out_error(empty, press, change, deviation, weight))


def left_out_residuals(
    press: Array, change: Array, deviation: Array, roughness: float, empty: Response | None = None
) -> tuple[Indices, Array]:
    """Rows (R,) of the presses that folds leave out, and the residuals (R, 5) of the fits without them. empty: what is
    fitted; None: a whole response."""
    return _left_out(empty or empty_response(press), press, change, deviation, roughness)


def with_shear(normal: Response, press: Array, added: Array, deviation: Array, roughness: float) -> Response:
    """`normal`, and what shear adds to it: `added` (K, 5) under presses (K, 5), to within `deviation` (K, 5)."""
    fitted = _solved(shear_alone(normal, press), press, added, deviation, roughness)
    of_normal = np.pad(normal.exponent, ((0, 0), (0, fitted.loads - normal.loads)))
    return replace(
        fitted,
        exponent=np.concatenate([of_normal, fitted.exponent]),
        coefficient=np.concatenate([normal.coefficient, fitted.coefficient], axis=2),
    )


def shear_alone(normal: Response, press: Array) -> Response:
    """A response to shear alone on the knots of `normal`, with coefficients zero."""
    exponent = np.array(SHEAR_EXPONENTS, dtype=np.intp)
    coefficient = np.zeros((*normal.coefficient.shape[:2], len(exponent), CHANGE))
    friction = empty_response(press).friction
    return replace(normal, exponent=exponent, coefficient=coefficient, friction=friction)


def empty_response(press: Array) -> Response:
    """A response with knots and monomials that suit the presses (K, 2 + L), and coefficients zero."""
    cells = np.array([_cells(press[:, axis]) for axis in (0, 1)])
    first, last = press[:, :2].min(axis=0), press[:, :2].max(axis=0)
    exponent, force = _exponents(press[:, 2:]), press[:, 2]
    shape = (*(cells + 3), len(exponent), CHANGE)
    shear = np.hypot(*press[:, 3:].T) if press.shape[1] > 3 else np.zeros(len(press))
    friction = float(np.max(shear[force > 0.0] / force[force > 0.0]))
    return Response(first, (last - first) / cells, float(force.max()), exponent, np.zeros(shape), friction)


def _cells(coordinate_mm: Array) -> int:
    """Number of cells along one axis: those of a grid, or as many as scattered presses determine."""
    distinct = len(np.unique(np.round(coordinate_mm, 6)))
    scattered = distinct > len(coordinate_mm) / 4
    cells = int(np.sqrt(len(coordinate_mm) / 4)) if scattered else distinct - 1
    return min(max(cells, FEWEST_CELLS), MOST_CELLS)


def _exponents(load: Array) -> Indices:
    """Exponents of the monomials: of the normal force up to its number of levels, and of shear if there is any."""
    force = load[load[:, 0] > 0.0, 0]
    normal = [(power, *(0,) * (load.shape[1] - 1)) for power in range(1, min(_levels(force), NORMAL_POWERS) + 1)]
    return np.array(normal + list(SHEAR_EXPONENTS if load.shape[1] > 1 else ()), dtype=np.intp)


def _levels(force: Array) -> int:
    """Number of force levels. A level begins at its lightest press, so that scatter does not split it."""
    count, lightest = 0, -np.inf
    for one in np.sort(force):
        if one > lightest + LEVEL_SHARE * force.max():
            count, lightest = count + 1, one
    return count


def _left_out_error(empty: Response, press: Array, change: Array, deviation: Array, roughness: float) -> float:
    """Sum of squared (residual / deviation) of left-out presses."""
    rows, residual = _left_out(empty, press, change, deviation, roughness)
    return float(np.sum((residual / deviation[rows]) ** 2))


def _left_out(
    empty: Response, press: Array, change: Array, deviation: Array, roughness: float
) -> tuple[Indices, Array]:
    """Rows and residuals of left-out presses, in random folds.

    Presses at the table's edge are in every fit: without them the residuals would be those of an extrapolation.
    """
    fold = np.random.default_rng(0).permutation(len(press)) % FOLDS
    inner = ((press[:, :2] > empty.first_mm) & (press[:, :2] < empty.last_mm)).all(axis=1)
    rows, residuals = list[Indices](), list[Array]()
    for left_out in range(FOLDS):
        out = (fold == left_out) & inner
        kept = ~out
        fitted = _solved(empty, press[kept], change[kept], deviation[kept], roughness)
        rows.append(np.flatnonzero(out))
        residuals.append(change[out] - fitted.change(press[out]))
    return np.concatenate(rows), np.concatenate(residuals)


def _solved(empty: Response, press: Array, change: Array, deviation: Array, roughness: float) -> Response:
    """Least squares, with presses weighted by their deviation, and with third differences penalised."""
    basis = empty.basis(press).reshape(len(press), -1)
    penalty = _roughness(empty.coefficient.shape[:3], empty.exponent)
    # One weight for a press's five components, whose deviations vary alike from press to press: one matrix serves all.
    weight = 1.0 / np.mean((deviation / np.median(deviation, axis=0)) ** 2, axis=1)
    normal = basis.T @ (weight[:, None] * basis)
    # Relative to the weight of the data, so that `roughness` does not depend on units and the number of presses.
    scale = roughness * np.trace(normal) / np.trace(penalty)
    coefficient = np.linalg.solve(normal + scale * penalty, basis.T @ (weight[:, None] * change))
    return replace(empty, coefficient=coefficient.reshape(empty.coefficient.shape))


def _roughness(shape: tuple[int, ...], exponent: Indices) -> Array:
    """The quadratic form of third differences along x and y, the same for every monomial. A small ridge makes it
    positive definite."""
    size_x, size_y, monomials = shape
    identity_x, identity_y = np.eye(size_x), np.eye(size_y)
    third_x, third_y = (np.diff(identity, 3, axis=0) for identity in (identity_x, identity_y))
    along = np.kron(third_x.T @ third_x, identity_y) + np.kron(identity_x, third_y.T @ third_y)
    ridge = 1e-9 * np.eye(size_x * size_y)
    return np.asarray(np.kron(along + ridge, np.eye(monomials)), dtype=np.float64)
