"""The measurement model: what each scalar measurement would read in a given state, and its weight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import product
from fmfts.pose.dipole import dipole_derivatives
from fmfts.pose.problem import AGE, DIRECTION, NOISE, PLACE, PROPORTIONAL, VALUE, Problem
from fmfts.pose.state import (
    AMBIENT,
    AXIS,
    GRADIENT,
    LOG_MOMENT,
    NEIGHBOUR_SIZE,
    POSITION,
    SIZE,
    Neighbour,
    State,
    tangent_basis,
)

Array = NDArray[np.float64]

UNIT = 1e-6  # the length of a unit vector may differ from one by this


def usable_rows(problem: Problem) -> Array | None:
    """The measurements that have a value; None if one of them is invalid."""
    rows = problem.measurements
    rows = rows[np.isfinite(rows[:, VALUE]) & (rows[:, NOISE] != np.inf)]
    length = np.sqrt(square(rows[:, DIRECTION]).sum(axis=1))
    whole = bool(np.isfinite(rows).all() and (np.abs(length - 1.0) <= UNIT).all())
    return rows if whole and (rows[:, NOISE] > 0.0).all() and (rows[:, [PROPORTIONAL, AGE]] >= 0.0).all() else None


def brought_to_now(problem: Problem, rows: Array) -> tuple[Array, Array]:
    """Values (rows,) T, extrapolated to the state's time, and one over their standard deviations (rows,).

    The extrapolation is linear about the start: the known rate moves the value, and diffusion adds to its variance.
    """
    with np.errstate(over="ignore"):
        value, variance = rows[:, VALUE], square(rows[:, NOISE]) + square(rows[:, PROPORTIONAL] * rows[:, VALUE])
    if problem.motion is not None:
        _, jacobian = predict(rows, problem.magnets, problem.start)
        value = value + rows[:, AGE] * product(jacobian, problem.motion.rate)
        variance = variance + rows[:, AGE] * product(jacobian * jacobian, problem.motion.diffusion)
    with np.errstate(divide="ignore"):
        return value, 1.0 / np.sqrt(variance)


def predict(rows: Array, magnets: Array, state: State) -> tuple[Array, Array]:
    """What each measurement (rows, 10) would read (rows,) in tesla, and its derivative by a step (rows, columns)."""
    place, direction = rows[:, PLACE], rows[:, DIRECTION]
    jacobian = np.empty((len(rows), state.columns))
    predicted = product(direction, state.ambient_t)
    jacobian[:, AMBIENT] = direction
    (x, y, z), (dx, dy, dz) = place.T, direction.T
    by_gradient = (dx * x - dz * z, dx * y + dy * x, dx * z + dz * x, dy * y - dz * z, dy * z + dz * y)
    jacobian[:, GRADIENT] = np.stack(by_gradient, axis=1)
    predicted += product(jacobian[:, GRADIENT], state.gradient_t_per_m)
    for (first, magnet), (strength, octupole) in zip(magnets_of(state), magnets, strict=True):
        moment = strength * exp(magnet.log_moment)
        field, by_position, by_axis = dipole_derivatives(place, magnet.position_m, magnet.axis, moment, octupole)
        own = jacobian[:, first : first + NEIGHBOUR_SIZE]
        own[:, POSITION] = product(direction[:, None], by_position)[:, 0]
        own[:, AXIS] = product(product(direction[:, None], by_axis)[:, 0], tangent_basis(magnet.axis))
        own[:, LOG_MOMENT] = (direction * field).sum(axis=1)
        predicted += own[:, LOG_MOMENT]
    return predicted, jacobian


def magnets_of(state: State) -> list[tuple[int, State | Neighbour]]:
    """The first column of each magnet in the state, and the magnet."""
    others = ((SIZE + NEIGHBOUR_SIZE * index, other) for index, other in enumerate(state.neighbours))
    return [(0, state), *others]
