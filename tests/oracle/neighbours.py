"""A neighbouring pad's magnets in another pad's axes, and their effect on its field, by differences of the potential.

A magnet moves by at most 0.02 m/s and turns by 2 rad/s (a tap of 1 N in 50 ms), no farther than 1.2 mm and 0.2 rad (the
paper's hardest press); its log moment is never known better than 1e-3. An error of placement or rest changes a dipole's
change of field by 4/r of itself per metre.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from fmfts.pad import Magnet, Placement, SensorArray
from fmfts.pose.sighting import Sighting
from oracle.field import Array, OneMagnet, differences, field, tangents, turned

STEPS = np.array([1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4])


def placed(values: Array, placement: Placement) -> Array:
    """(M, 7) position, axis and log moment, in this pad's axes."""
    turn = placement.rotation.T
    return np.concatenate([values[:, :3] @ turn + placement.position_m, values[:, 3:6] @ turn, values[:, 6:]], axis=1)


def stepped(values: Array, step: Array) -> Array:
    """(M, 7) moved by `step` (6M,)."""
    moved = [
        [*(one[:3] + own[:3]), *turned(one[3:6], own[3:5]), one[6] + own[5]]
        for one, own in zip(values, step.reshape(-1, 6), strict=True)
    ]
    return np.array(moved)


def covariance(sighting: Sighting, placement: Placement, age_s: float) -> Array:
    """The covariance (6M, 6M) of a step from the magnets' present poses. age_s: infinite if they were never seen."""
    last = np.array([[*one.position_m, *one.axis, one.log_moment] for one in sighting.last])
    here, nowhere = placed(last, placement), np.zeros(6 * len(last))

    def arrived(step: Array) -> Array:
        there = placed(stepped(last, step), placement)
        return np.concatenate(
            [[*(b[:3] - a[:3]), *(tangents(a[3:6]).T @ b[3:6]), b[6] - a[6]] for a, b in zip(here, there, strict=True)]
        )

    turn = differences(arrived, nowhere, np.tile(STEPS, len(last)))
    moved_m, turned_rad = min(0.02 * age_s, 1.2e-3), min(2.0 * age_s, 0.2)
    widened = np.tile(np.square([moved_m] * 3 + [turned_rad] * 2 + [1e-3]), len(last))
    return np.asarray(turn @ sighting.covariance @ turn.T + np.diag(widened))


def fields(magnets: tuple[Magnet, ...], values: Array, sensors: SensorArray) -> Array:
    """The fields (M, N, 3) of each magnet, along the sensors' axes."""
    each = [
        field(
            OneMagnet(one[:3], one[3:6], one[6], magnet.strength_t_m3, magnet.modelled_octupole_m2), sensors.position_m
        )
        for magnet, one in zip(magnets, values, strict=True)
    ]
    return np.asarray(np.einsum("nij,mni->mnj", sensors.axes, np.array(each)))


def variance(sighting: Sighting, placement: Placement, sensors: SensorArray) -> Array:
    """(N,) T² along each axis, from errors of placement and of the magnets' rest."""
    last, rest = (
        placed(np.array([[*one.position_m, *one.axis, one.log_moment] for one in where]), placement)
        for where in (sighting.last, sighting.rest)
    )
    total = np.zeros(len(sensors))
    changes = fields(sighting.magnets, last, sensors) - fields(sighting.magnets, rest, sensors)
    for change, one, (off_m, share) in zip(changes, last, sighting.rest_error, strict=True):
        away_m = np.linalg.norm(sensors.position_m - one[:3], axis=1)
        by_place = (4.0 * placement.tolerance_m / away_m) ** 2 + (4.0 * off_m / away_m) ** 2
        total += (change**2).sum(axis=1) * (by_place + share**2) / 3.0
    return total


def together(covariances: list[Array]) -> Array:
    return np.asarray(block_diag(*covariances))
