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

    def add(value: Array, *terms: tuple[int, int, Array]) -> None:
        """value (H, n). terms: a step, its first unknown of six, and derivatives (…, n, unknowns)."""
        slope = np.zeros((*value.shape, steps, 6))
        for step, first, derivative in terms:
            slope[:, :, step, first : first + derivative.shape[-1]] += derivative
        rows.append(value)
        slopes.append(slope.reshape(*value.shape, -1))

    add(position[:, 0, :2] / hand.middle_sd_m, (0, 0, np.eye(2) / hand.middle_sd_m))
    height = position[:, 0, 2, None]
    per_height = 1.0 / (height[:, :, None] * hand.log_height_sd)
    add(np.log(height / hand.height_m) / hand.log_height_sd, (0, 2, per_height))
    for step in range(1, steps):
        per = 1.0 / hand.offset_sd_m[step]
        offset = position[:, step] - position[:, 0] - hand.offset_m[step]
        add(offset * per, (step, 0, np.diag(per)), (0, 0, -np.diag(per)))
    size = np.sqrt((moment**2).sum(axis=2))
    pole = np.full(count, float(hand.pole)) if hand.pole else np.where(moment[:, 0, 2] < 0.0, -1.0, 1.0)
    upright = pole[:, None] * np.array([0.0, 0.0, 1.0])
    for step in range(steps):
        unit = moment[:, step] / size[:, step, None]
        by = (np.eye(3) - unit[:, :, None] * unit[:, None]) / (size[:, step, None, None] * hand.direction_sd)
        add((unit - upright) / hand.direction_sd, (step, 3, by))
        if step:
            first, this = (
                (moment[:, each] / size[:, each, None] ** 2 / hand.log_moment_sd)[:, None] for each in (0, step)
            )
            change = np.log(size[:, step] / size[:, 0]) / hand.log_moment_sd
            add(change[:, None], (0, 3, -first), (step, 3, this))
    return np.concatenate(rows, axis=1), np.concatenate(slopes, axis=1)
