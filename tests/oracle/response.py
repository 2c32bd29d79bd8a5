"""The table of a pad's response and its most likely press, by NumPy: contact/response.py has the equations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import inverse, product, solve
from fmfts.contact.response import Response

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

DAMPING, DAMPING_FACTOR = 1e-3, 10.0
FARTHEST_LOAD = 3.0  # presses are searched up to this multiple of the calibrated force


def change_and_slope(response: Response, press: Array) -> tuple[Array, Array]:
    """The change (K, 5), and its derivative (K, 5, 2 + L) by the press."""
    (column, along_x, slope_x), (row, along_y, slope_y) = (_stencil(response, press[:, axis], axis) for axis in (0, 1))
    patch = response.coefficient[column[:, :, None], row[:, None, :]]
    value, by_load = _monomials(response, press[:, 2:])
    loads = np.concatenate([value[:, :, None], by_load], axis=2)
    # (K, 4, 4, 5, 1 + L), then summed along y, then along x.
    of_load = product(patch.swapaxes(3, 4), loads[:, None, None])
    across = _summed(along_y[:, None, :, None, None] * of_load, axis=2)
    whole = _summed(along_x[:, :, None, None] * across, axis=1)
    by_x = _summed(slope_x[:, :, None] * across[..., 0], axis=1)
    by_y = _summed(along_x[:, :, None] * _summed(slope_y[:, None, :, None] * of_load[..., 0], axis=2), axis=1)
    return whole[..., 0], np.concatenate([by_x[..., None], by_y[..., None], whole[..., 1:]], axis=2)


def _stencil(response: Response, coordinate_mm: Array, axis: int) -> tuple[Indices, Array, Array]:
    """Indices, values and derivatives (K, 4) of the four cubic B-splines that cover each coordinate."""
    knots = response.coefficient.shape[axis] - 2
    place = np.clip((coordinate_mm - response.first_mm[axis]) / response.spacing_mm[axis], 0.0, knots - 1.0)
    cell = np.minimum(place.astype(np.intp), knots - 2)
    u = place - cell
    v = 1.0 - u
    value = np.stack(
        [v * v * v, 3.0 * u * u * u - 6.0 * u * u + 4.0, -3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0, u * u * u],
        axis=1,
    )
    slope = np.stack([-v * v, 3.0 * u * u - 4.0 * u, -3.0 * u * u + 2.0 * u + 1.0, u * u], axis=1)
    return cell[:, None] + np.arange(4), value / 6.0, slope / 2.0 / response.spacing_mm[axis]


def _monomials(response: Response, load: Array) -> tuple[Array, Array]:
    """Monomials (K, M), derivatives (K, M, L). Above scale_n, powers of the normal force follow their tangents."""
    inside = load / response.scale_n
    beyond = np.maximum(inside[:, 0] - 1.0, 0.0)
    inside[:, 0] -= beyond
    whole_powers = [np.ones_like(inside)]
    for _ in range(int(response.exponent.max(initial=0))):
        whole_powers.append(whole_powers[-1] * inside)
    powers, load_index = np.stack(whole_powers), np.arange(response.loads)
    # (K, M, L) each: loads to the power of the exponent, and of one less.
    power = powers[response.exponent, :, load_index].transpose(2, 0, 1)
    lower = powers[np.maximum(response.exponent - 1, 0), :, load_index].transpose(2, 0, 1)
    by_load = lower * response.exponent
    power[:, :, 0] += by_load[:, :, 0] * beyond[:, None]
    slope = np.empty_like(power)
    for index in range(response.loads):
        slope[:, :, index] = by_load[:, :, index] * np.delete(power, index, axis=2).prod(axis=2) / response.scale_n
    return power.prod(axis=2), slope


def most_likely(
    response: Response, change: Array, covariance: Array, start: Array, steps: int
) -> tuple[Array, Array, Array]:
    """The presses (K, 2 + L) that best explain `change` (K, 5) with `covariance` (K, 5, 5), near `start` (K, 2 + L).

    It takes `steps` trials of Levenberg–Marquardt, within `press_limits`. Also returns the covariance of the presses
    (K, 2 + L, 2 + L) and χ² (K,). With steps = 2 from the network's answer, this is [pad.contact] refine.
    """
    information = inverse(covariance)
    lowest, highest = press_limits(response)
    press = np.clip(start, lowest, highest)
    modelled, slope = change_and_slope(response, press)
    chi2 = _misfit(change - modelled, information)
    damping = np.full(len(press), DAMPING)
    for _ in range(steps):
        gradient = product(slope.transpose(0, 2, 1), information, (change - modelled)[..., None])
        step = solve(_damped(_normal(slope, information), damping), gradient)[..., 0]
        trial = np.clip(press + step, lowest, highest)
        trial_modelled, trial_slope = change_and_slope(response, trial)
        trial_chi2 = _misfit(change - trial_modelled, information)
        better = trial_chi2 <= chi2
        press[better], chi2[better] = trial[better], trial_chi2[better]
        modelled[better], slope[better] = trial_modelled[better], trial_slope[better]
        damping = np.where(better, damping / DAMPING_FACTOR, damping * DAMPING_FACTOR)
    return press, inverse(_normal(slope, information)), chi2


def press_limits(response: Response) -> tuple[Array, Array]:
    """The smallest and the largest press (2 + L,) of a search."""
    farthest = FARTHEST_LOAD * response.scale_n
    shear = np.full(response.loads - 1, farthest)
    return (
        np.concatenate([response.first_mm, [0.0], -shear]),
        np.concatenate([response.last_mm, [farthest], shear]),
    )


def _normal(slope: Array, information: Array) -> Array:
    """Information (K, 2 + L, 2 + L) on the presses, plus a prior deviation of 1 m: at rest, the place is unknown."""
    normal: Array = product(slope.transpose(0, 2, 1), information, slope)
    return normal + 1e-6 * np.eye(normal.shape[1])


def _damped(normal: Array, damping: Array) -> Array:
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    damped: Array = normal + np.eye(normal.shape[1]) * (diagonal * damping[:, None])[:, :, None]
    return damped


def _misfit(residual: Array, information: Array) -> Array:
    misfit: Array = product(residual[:, None], information, residual[:, :, None])[:, 0, 0]
    return misfit


def _summed(terms: Array, axis: int) -> Array:
    """Sum one after the other, in the order of response.c."""
    total, *others = np.moveaxis(terms, axis, 0)
    for term in others:
        total = total + term
    return np.asarray(total)
