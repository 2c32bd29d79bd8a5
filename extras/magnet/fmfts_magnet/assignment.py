"""Compares each channel with every place, turn and scale, under a magnet that is assumed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts_magnet.magnet import Explanations, Fitter, Magnets, fields
from fmfts_magnet.readings import Array
from fmfts_magnet.symmetry import TURNS

SCALES = (1.0, 0.5, 2.0)
LIKE_A_SCALE = 0.2  # distance of logarithms below which the nearest of SCALES is tried
ROUGH = 0.08  # relative error of a reading while magnets are guessed
WORTH_A_FAULT = 15.0  # decrease of χ² that shows a difference of a channel from the drawing, while guessing


def assigned(fitter: Fitter, used: NDArray[np.bool_], magnets: Magnets) -> tuple[Explanations, Magnets]:
    """The explanations that fit these magnets best: with places free or as drawn, faults likely or rare."""
    from scipy.optimize import linear_sum_assignment

    count = fitter.channels
    misfit, turn, scale = _compared(fitter, magnets)
    drawn = np.arange(count)
    parts = []
    for penalty in (0.0, WORTH_A_FAULT):
        weighed = misfit + penalty * ((turn > 0).astype(float)[..., None] + (np.array([0, 1, 1, 1]) > 0))
        flat = weighed.reshape(count, count, -1)
        cheapest = flat.argmin(axis=2)
        best = flat.min(axis=2)
        moved = best + penalty * (1.0 - np.eye(count))
        moved[~used] = np.where(np.eye(count), 0.0, 1e6)[~used]
        for place in {tuple(linear_sum_assignment(moved)[1].tolist()), tuple(drawn.tolist())}:
            at = np.array(place)
            which, kind = np.divmod(cheapest[drawn, at], 4)
            of_turn = turn[drawn, at, which]
            fitted = scale[drawn, at, which]
            free = kind == 3
            value = np.where(free, fitted, np.array((*SCALES, 1.0))[kind])
            near = np.abs(np.log(value[:, None] / np.array(SCALES)))
            parts.append(
                Explanations(
                    at[None],
                    TURNS[of_turn][None],
                    value[None],
                    (free & (near.min(axis=1) > 0.0))[None],
                    used[None],
                )
            )
    joined = Explanations.joined(*parts)
    joined.turn[:, ~used] = np.eye(3)
    joined.scale[:, ~used] = 1.0
    joined.free[:, ~used] = False
    return joined, magnets[np.zeros(len(joined), dtype=np.intp)]


def _compared(fitter: Fitter, magnets: Magnets) -> tuple[Array, NDArray[np.intp], Array]:
    """Of channel, place and turn: χ² (N, N, 2, 4) with each of SCALES and with a free scale, the number of the turn
    (N, N, 2), the drawn one first, then the best one; and the free scale (N, N, 2)."""
    field = fields(fitter.board, magnets)[0][0]  # (K, N, 3)
    drawn = np.einsum("pij,kpi->pkj", fitter.board.axes, field)
    change = np.moveaxis(fitter.change, 1, 0)  # (N, K, 3)
    known = np.moveaxis(~fitter.missing, 1, 0)
    error = ROUGH * np.sqrt((change**2).sum(axis=2, keepdims=True)) + 1e-6
    weight = known / error**2
    product = np.einsum("cki,pkj->cpij", weight * change, drawn)
    like = np.einsum("sij,cpij->cps", TURNS, product)
    best = like.argmax(axis=2)
    turn = np.stack([np.zeros_like(best), best], axis=2)
    along = np.take_along_axis(like, turn, axis=2)
    turned = np.einsum("cptij,pkj->cptki", TURNS[turn], drawn)
    power = np.einsum("cki,cptki->cpt", weight, turned**2)
    data = np.einsum("cki,cki->c", weight, change**2)[:, None, None]
    scale = np.maximum(along / np.maximum(power, 1e-30), 1e-2)
    near = np.array(SCALES)[np.abs(np.log(scale[..., None] / np.array(SCALES))).argmin(axis=3)]
    snapped = np.where(np.abs(np.log(scale / near)) < LIKE_A_SCALE, near, scale)
    scales = np.stack([*(np.full(scale.shape, each) for each in SCALES), snapped], axis=3)
    misfit = data[..., None] - 2.0 * scales * along[..., None] + scales**2 * power[..., None]
    return misfit, turn, snapped
