"""From measured changes of pose to the smooth response of a pad: penalised least squares on its coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.contact.response import CHANGE, Array, Indices, Response

# Of the normal force: three are exact to 0.01 mm up to 2 N, five up to 4 N. Forces within a seventh of the largest
# are one level: a stage reaches them to 5 % or worse, and such scatter tells no curvature.
NORMAL_POWERS, LEVEL_SHARE = 5, 0.15
# Loads: normal, shear x, shear y. Shear acts in proportion, a little stronger on a squeezed pad, and in its square.
SHEAR_EXPONENTS = ((0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 2, 0), (0, 1, 1), (0, 0, 2))
# Weights of roughness, over that of the data: from "pass through every point" to "noise is most of it".
ROUGHNESS = (1e-7, 1e-5, 1e-3, 1e-1)
MOST_CELLS, FEWEST_CELLS = 20, 4
FOLDS = 5


def fit_response(press: Array, change: Array, deviation: Array, roughness: float | None = None) -> Response:
    """The smoothest response that explains `change` (K, 5) under presses (K, 2 + L) to within `deviation` (K, 5).

    roughness: None takes `best_roughness`.
    """
    if roughness is None:
        roughness = best_roughness(press, change, deviation)
    return _solved(empty_response(press), press, change, deviation, roughness)


def best_roughness(press: Array, change: Array, deviation: Array) -> float:
    """The weight of ROUGHNESS that predicts left-out presses best, in five folds."""
    empty = empty_response(press)
    return min(ROUGHNESS, key=lambda weight: _left_out_error(empty, press, change, deviation, weight))


def left_out_residuals(press: Array, change: Array, deviation: Array, roughness: float) -> tuple[Indices, Array]:
    """Rows (R,) of the presses that folds leave out, and by how much (R, 5) the fit without each misses its change."""
    return _left_out(empty_response(press), press, change, deviation, roughness)


def empty_response(press: Array) -> Response:
    """Knots and monomials that suit the presses (K, 2 + L); coefficients zero."""
    cells = np.array([_cells(press[:, axis]) for axis in (0, 1)])
    first, last = press[:, :2].min(axis=0), press[:, :2].max(axis=0)
    exponent, force = _exponents(press[:, 2:]), press[:, 2]
    shape = (*(cells + 3), len(exponent), CHANGE)
    shear = np.hypot(*press[:, 3:].T) if press.shape[1] > 3 else np.zeros(len(press))
    friction = float(np.max(shear[force > 0.0] / force[force > 0.0]))
    return Response(first, (last - first) / cells, float(force.max()), exponent, np.zeros(shape), friction)


def _cells(coordinate_mm: Array) -> int:
    """As many as a grid has, or as scattered presses determine."""
    distinct = len(np.unique(np.round(coordinate_mm, 6)))
    scattered = distinct > len(coordinate_mm) / 4
    cells = int(np.sqrt(len(coordinate_mm) / 4)) if scattered else distinct - 1
    return min(max(cells, FEWEST_CELLS), MOST_CELLS)


def _exponents(load: Array) -> Indices:
    """Monomials of a degree that the levels of the normal force determine, and of shear where there is any."""
    force = load[load[:, 0] > 0.0, 0]
    normal = [(power, *(0,) * (load.shape[1] - 1)) for power in range(1, min(_levels(force), NORMAL_POWERS) + 1)]
    return np.array(normal + list(SHEAR_EXPONENTS if load.shape[1] > 1 else ()), dtype=np.intp)


def _levels(force: Array) -> int:
    """How many forces there are; each begins with its lightest press, so that no scatter makes two of one."""
    count, lightest = 0, -np.inf
    for one in np.sort(force):
        if one > lightest + LEVEL_SHARE * force.max():
            count, lightest = count + 1, one
    return count


def _left_out_error(empty: Response, press: Array, change: Array, deviation: Array, roughness: float) -> float:
    """Squared error in deviations of presses that were left out of the fit."""
    rows, residual = _left_out(empty, press, change, deviation, roughness)
    return float(np.sum((residual / deviation[rows]) ** 2))


def _left_out(
    empty: Response, press: Array, change: Array, deviation: Array, roughness: float
) -> tuple[Indices, Array]:
    """Rows and residuals, in folds that interleave.

    Presses at the table's edge are kept in every fold: without them it would be extrapolation that is judged.
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
    """Least squares: presses weighted by their deviation, third differences held small."""
    basis = empty.basis(press).reshape(len(press), -1)
    penalty = _roughness(empty.coefficient.shape[:3], empty.exponent)
    # One weight for a press's five components, so that one matrix serves all: from press to press they change alike.
    weight = 1.0 / np.mean((deviation / np.median(deviation, axis=0)) ** 2, axis=1)
    normal = basis.T @ (weight[:, None] * basis)
    # Relative to the data's own weight, so that it means the same for any unit and any number of presses.
    scale = roughness * np.trace(normal) / np.trace(penalty)
    coefficient = np.linalg.solve(normal + scale * penalty, basis.T @ (weight[:, None] * change))
    return replace(empty, coefficient=coefficient.reshape(empty.coefficient.shape))


def _roughness(shape: tuple[int, ...], exponent: Indices) -> Array:
    """The quadratic form of third differences along x and y, the same for every monomial; a trace of ridge makes it
    definite."""
    size_x, size_y, monomials = shape
    identity_x, identity_y = np.eye(size_x), np.eye(size_y)
    third_x, third_y = (np.diff(identity, 3, axis=0) for identity in (identity_x, identity_y))
    along = np.kron(third_x.T @ third_x, identity_y) + np.kron(identity_x, third_y.T @ third_y)
    ridge = 1e-9 * np.eye(size_x * size_y)
    return np.asarray(np.kron(along + ridge, np.eye(monomials)), dtype=np.float64)
