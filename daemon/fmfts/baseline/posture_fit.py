"""Fits the field of a posture: the smallest smooth function of the joints that predicts parts left out of its fit."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product as combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import inverse, lengths, product, singular_values, solve
from fmfts.baseline.recording import BaselineError
from fmfts.pad import Array
from fmfts.pose.posture import PostureModel, basis_of

MOVES_RAD = 0.01  # a joint that moves by less stands still
MOST_COORDINATES, LEAST_SHARE = 6, 0.02  # of the largest coordinate's spread
MOST_TERMS, ROWS_OF_A_TERM, HIGHEST = 80, 6, 12
BLOCKS = 8  # parts of the recording, each left out in turn
RIDGES = (1e-6, 1e-3, 3e-2)  # of the number of rows; a term's order raises its share with its square
# A function with more terms must explain left-out rows better by this.
BETTER = 0.98
SHRUNK = 0.05  # of the covariance of what is left, towards its diagonal
FEWEST_ROWS = 60
Indices = NDArray[np.intp]


class Taught(NamedTuple):
    """model, and the uneven change of the field (rms, T) before and after subtracting the posture; terms: how many.
    even_t: deviation of the even part, which is not modelled."""

    model: PostureModel
    uneven_t: float
    left_t: float
    terms: int
    even_t: float


def fit_posture(names: tuple[str, ...], joints_rad: Array, change_t: Array, by_ambient: Array) -> Taught:
    """joints_rad (K, J), change_t (K, P): of the field since rest. J may be 0: then only the spread is learned.

    by_ambient (P, 3): each value by the ambient field. BaselineError if the rows do not determine it.
    """
    if len(change_t) < FEWEST_ROWS:
        raise BaselineError(f"only {len(change_t)} moments with fields and joint positions; {FEWEST_ROWS} are needed")
    even, uneven = _parts(change_t, by_ambient)
    even_t = float(lengths(even - even.mean(axis=0)).max()) / 2.0  # a deviation
    mean = uneven.mean(axis=0)
    middle, off, axes = _coordinates(joints_rad)
    if names and not len(axes):
        raise BaselineError(
            f"no joint moved by more than {MOVES_RAD:g} rad meanwhile: move the hand through all its postures, or "
            "record it with --no-joints if no program publishes joint positions"
        )
    spread = _spread(uneven - mean)
    if not names:
        nothing = np.zeros((0, change_t.shape[1]))
        left = 1e-12 * np.eye(len(mean)) * spread.max()
        no_terms = np.zeros((0, 0))
        model = PostureModel(names, middle, off, axes, no_terms, nothing, no_terms, left, mean, spread)
        return Taught(model, _rms(uneven), _rms(uneven), 0, even_t)
    along = product(joints_rad - middle, axes.T)
    exponents, ridge, left = _best(along, uneven)
    basis = basis_of(exponents, along)
    normal = _normal(basis, exponents, ridge)
    weight = solve(normal, product(basis.T, uneven))
    model = PostureModel(names, middle, off, axes, exponents, weight, inverse(normal), _spread(left), mean, spread)
    return Taught(model, _rms(uneven), _rms(left), len(exponents), even_t)


def _parts(change_t: Array, by_ambient: Array) -> tuple[Array, Array]:
    """The even field (K, 3), and what is left (K, P)."""
    even: Array = solve(product(by_ambient.T, by_ambient), product(by_ambient.T, change_t.T)).T
    return even, change_t - product(by_ambient, even.T).T


def _coordinates(joints_rad: Array) -> tuple[Array, Array, Array]:
    """The middle (J,), how far rows are off the coordinates (J,), and the axes (m, J)."""
    low, high = joints_rad.min(axis=0, initial=np.inf), joints_rad.max(axis=0, initial=-np.inf)
    middle: Array = (low + high) / 2.0
    if not (high - low > MOVES_RAD).any():
        return middle, np.zeros(len(middle)), np.zeros((0, len(middle)))
    moving = np.where(high - low > MOVES_RAD, joints_rad - middle, 0.0)
    normal = product(moving.T, moving)
    left, size, _ = singular_values(normal)
    share = np.sqrt(size / size[0])
    count = min(int((share > LEAST_SHARE).sum()), MOST_COORDINATES)
    directions = left[:, :count].T
    along = product(moving, directions.T)
    # Each coordinate reaches from −1 to 1.
    middle = middle + product((along.min(axis=0) + along.max(axis=0)) / 2.0, directions)
    axes = directions / ((along.max(axis=0) - along.min(axis=0)) / 2.0)[:, None]
    off = np.abs(joints_rad - middle - product(joints_rad - middle, directions.T, directions)).max(axis=0)
    return middle, off, axes


def _best(along: Array, uneven: Array) -> tuple[Array, float, Array]:
    """Exponents, ridge and left-out residuals (K, P) of the function that explains left-out rows best."""
    best: tuple[float, Array, float, Array] | None = None
    for exponents in _candidates(along.shape[1], len(along)):
        basis = basis_of(exponents, along)
        for ridge in RIDGES:
            left = _left_out(basis, exponents, ridge, uneven)
            cost = float((left * left).sum())
            if best is None or cost < BETTER * best[0]:
                best = cost, exponents, ridge, left
    assert best is not None
    return best[1:]


def _candidates(coordinates: int, rows: int) -> Iterator[Array]:
    """All products of the first coordinates up to an order, from few terms to many."""
    most, found = min(MOST_TERMS, rows // ROWS_OF_A_TERM), []
    for used in range(1, coordinates + 1):
        for order in range(1, HIGHEST + 1):
            count = _terms(used, order)
            if count <= most:
                found.append((count, used, order))
    for _, used, order in sorted(found):
        chosen = [one for one in combinations(range(order + 1), repeat=used) if sum(one) <= order]
        yield np.array([[*one, *[0] * (coordinates - used)] for one in chosen], dtype=np.float64)


def _terms(coordinates: int, order: int) -> int:
    count = 1
    for one in range(1, coordinates + 1):
        count = count * (order + one) // one
    return count


def _left_out(basis: Array, exponents: Array, ridge: float, uneven: Array) -> Array:
    left = np.empty_like(uneven)
    for block in np.array_split(np.arange(len(basis)), BLOCKS):
        others = np.ones(len(basis), dtype=np.bool_)
        others[block] = False
        normal = _normal(basis[others], exponents, ridge)
        weight = solve(normal, product(basis[others].T, uneven[others]))
        left[block] = uneven[block] - product(basis[block], weight)
    return left


def _normal(basis: Array, exponents: Array, ridge: float) -> Array:
    order = exponents.sum(axis=1)
    smooth = ridge * len(basis) * (1e-3 + order * order)
    normal: Array = product(basis.T, basis) + np.diag(smooth)
    return normal


def _spread(rows: Array) -> Array:
    covariance = product(rows.T, rows) / len(rows)
    spread: Array = (1.0 - SHRUNK) * covariance + SHRUNK * np.diag(np.diagonal(covariance))
    return spread


def _rms(rows: Array) -> float:
    return float(np.sqrt((rows * rows).mean()))
