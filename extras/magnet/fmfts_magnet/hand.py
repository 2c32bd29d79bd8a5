"""Residuals of the fit from the instructions to the person who holds the magnet, and from its constant moment."""

from __future__ import annotations

import numpy as np

from fmfts_magnet.readings import Array, Hand


def of_hand(hand: Hand, position: Array, moment: Array) -> tuple[Array, Array]:
    """Residuals in deviations (H, R), and derivatives (H, R, 6K) by position and moment of each step.

    position, moment: (H, K, 3).
    """
    count, steps = position.shape[:2]
    rows: list[Array] = []
    slopes: list[Array] = []

    def add(value: Array, *terms: tuple[int, Array]) -> None:
        slope = np.zeros((count, 6 * steps))
        for column, derivative in terms:
            slope[:, column] += derivative
        rows.append(value)
        slopes.append(slope)

    one = np.ones(count)
    for axis in range(2):
        add(position[:, 0, axis] / hand.middle_sd_m, (axis, one / hand.middle_sd_m))
    height = position[:, 0, 2]
    add(np.log(height / hand.height_m) / hand.log_height_sd, (2, 1.0 / (height * hand.log_height_sd)))
    for step in range(1, steps):
        for axis in range(3):
            offset = position[:, step, axis] - position[:, 0, axis] - hand.offset_m[step, axis]
            per = one / hand.offset_sd_m[step, axis]
            add(offset * per, (6 * step + axis, per), (axis, -per))
    size = np.sqrt((moment**2).sum(axis=2))
    pole = np.full(count, float(hand.pole)) if hand.pole else np.where(moment[:, 0, 2] < 0.0, -1.0, 1.0)
    for step in range(steps):
        unit = moment[:, step] / size[:, step, None]
        for axis in range(3):
            by = (np.eye(3)[axis] - unit * unit[:, axis, None]) / (size[:, step, None] * hand.direction_sd)
            columns = [(6 * step + 3 + other, by[:, other]) for other in range(3)]
            add((unit[:, axis] - pole * (axis == 2)) / hand.direction_sd, *columns)
        if step:
            per_first, per_this = (
                moment[:, each] / size[:, each, None] ** 2 / hand.log_moment_sd for each in (0, step)
            )
            columns = [(3 + other, -per_first[:, other]) for other in range(3)]
            columns += [(6 * step + 3 + other, per_this[:, other]) for other in range(3)]
            add(np.log(size[:, step] / size[:, 0]) / hand.log_moment_sd, *columns)
    return np.stack(rows, axis=1), np.stack(slopes, axis=1)
