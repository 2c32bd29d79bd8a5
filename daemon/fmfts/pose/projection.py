"""Variable projection: for a given position of the magnet, its moment and the ambient field are linear unknowns.

They are solved for at each trial position, so Levenberg–Marquardt searches in three dimensions only (Kaufman's form),
and a start needs neither an axis nor a strength. G. Golub, V. Pereyra, "The differentiation of pseudo-inverses…", SIAM
J. Numer. Anal. 10 (1973) 413.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, log
from fmfts.arithmetic.matrix import SingularError, eigen, length, product, solve
from fmfts.pose.dipole import dipole_derivatives
from fmfts.pose.model import predict
from fmfts.pose.problem import DIRECTION, PLACE, VALUE, Part, Problem
from fmfts.pose.state import AMBIENT, LOG_MOMENT, State

Array = NDArray[np.float64]

SECULAR_STEPS = 50
SETTLED = 1e-14
HARD_CASE = 1e-10


def best_linear_parts(rows: Array, weight: Array, problem: Problem, state: State) -> State | None:
    """`state` with the axis that fits best at its position, and with the best moment and ambient field if estimated.

    Only the dipole is linear: the search's steps fit the octupole. A moment that is not estimated keeps its length.
    None if the measurements do not determine the moment.
    """
    try:
        return _best(rows, weight, problem, state)
    except SingularError:
        return None


def _best(rows: Array, weight: Array, problem: Problem, state: State) -> State | None:
    strength = float(problem.magnets[0, 0])
    _, _, by_moment = dipole_derivatives(rows[:, PLACE], state.position_m, state.axis, strength)
    design = weight[:, None] * product(rows[:, None, DIRECTION], by_moment)[:, 0]
    predicted, jacobian = predict(rows, problem.magnets, state)
    rest = weight * (rows[:, VALUE] - predicted + jacobian[:, LOG_MOMENT])
    normal, slope = product(design.T, design), product(design.T, rest)
    uniform = np.flatnonzero(np.isin(problem.parts[AMBIENT], (Part.FREE, Part.PRIOR)))
    own = weight[:, None] * rows[:, DIRECTION][:, uniform]
    curvature, pull = _with_prior(problem, state, uniform, product(own.T, own), product(own.T, rest))
    shared = solve(curvature, product(own.T, design))
    estimated = problem.parts[LOG_MOMENT] in (Part.FREE, Part.PRIOR)
    normal, slope = normal - product(design.T, own, shared), slope - product(shared.T, pull)
    moment = solve(normal, slope) if estimated else _of_length(normal, slope, exp(state.log_moment))
    size = length(moment)
    if not 0.0 < size < np.inf:
        return None
    ambient = state.ambient_t.copy()
    ambient[uniform] += solve(curvature, pull) - product(shared, moment)
    log_moment = log(size) if estimated else state.log_moment
    return replace(state, axis=moment / size, log_moment=log_moment, ambient_t=ambient)


def _with_prior(
    problem: Problem, state: State, uniform: NDArray[np.intp], curvature: Array, pull: Array
) -> tuple[Array, Array]:
    """The prior added to the normal equations of the ambient field's change from `state`."""
    held = problem.parts[AMBIENT][uniform] == Part.PRIOR
    if problem.prior is None or not held.any():
        return curvature, pull
    information = np.where(held, 1.0 / np.diagonal(problem.prior.covariance)[AMBIENT][uniform], 0.0)
    return curvature + np.diag(information), pull + information * (problem.prior.mean.ambient_t - state.ambient_t)[
        uniform
    ]


def _of_length(normal: Array, slope: Array, size: float) -> Array:
    """The lowest minimum of µᵀAµ − 2bᵀµ over |µ| = size: (A − λ)µ = b, with λ below the eigenvalues of A.

    λ is found with Newton's method on 1/|µ(λ)|, which is nearly linear, from the side where it converges monotonically
    (A. Conn, N. Gould, P. Toint, "Trust-Region Methods", 2000, section 7.3).
    """
    values, vectors = eigen(normal)
    turned = product(vectors.T, slope)
    # Without a component along the weakest direction, both of its signs are equally good: take one.
    turned[0] = np.copysign(max(abs(turned[0]), HARD_CASE * length(turned)), turned[0])
    shift = values[0] - abs(turned[0]) / size
    for _ in range(SECULAR_STEPS):
        moment = turned / (values - shift)
        reached = length(moment)
        if abs(reached - size) <= SETTLED * size:
            break
        shift -= (reached / size - 1.0) * reached * reached / product(moment, moment / (values - shift))
    best: Array = product(vectors, moment)
    return best * (size / reached)
