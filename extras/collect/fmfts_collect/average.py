"""Averages the frames and forces of a row; refuses a moving or saturated field, and a pad that is not touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.baseline import BaselineError, Mounting
from fmfts.baseline.array_mounting import ArrayMounting, moved_since
from fmfts.baseline.recording import Recording, summarise
from fmfts.common.chi2 import quantile
from fmfts.pad import Array, Pad
from fmfts.pose import FREE_FIELD, solve
from fmfts.sensor import Frame
from fmfts_collect.errors import RefusedError
from fmfts_collect.gauge import Reading

# Probability that noise alone makes an untouched pad look touched.
FALSE_TOUCH = 1e-4
# Largest standard deviation of the force within a row: relative to the force, and absolute. The larger limit counts.
STEADY_FORCE = 0.1
STEADY_FORCE_N = 0.02


@dataclass(frozen=True, slots=True)
class Averaged:
    """The mean of some frames, and of the forces in the same time (None where there is no gauge)."""

    field: Recording
    force_n: float | None
    force_sd_n: float
    frames: Sequence[Frame]


class RowError(Exception):
    """The frames and forces make no row; the text says why. The row may be tried again."""


def average(frames: Sequence[Frame], readings: Sequence[Reading], tare_n: float) -> Averaged:
    """The means of a row. Raises RowError where the field is not steady or not complete, or the force not steady."""
    try:
        field = summarise(frames)
    except BaselineError as error:
        raise RowError(str(error)) from error
    if not readings:
        return Averaged(field, None, 0.0, frames)
    forces = np.array([reading.force_n for reading in readings]) - tare_n
    mean_n, spread_n = float(forces.mean()), float(forces.std())
    if spread_n > max(STEADY_FORCE * abs(mean_n), STEADY_FORCE_N):
        raise RowError(f"the force swings by {spread_n:.3f} N about {mean_n:.3f} N: is the pad held still?")
    return Averaged(field, mean_n, spread_n, frames)


def require_touched(loaded: Averaged, unloaded: Averaged) -> None:
    """Raise RowError where the field is that of the untouched pad, so that the rod presses on something else."""
    change = loaded.field.mean_t - unloaded.field.mean_t
    variance = loaded.field.mean_deviation_t**2 + unloaded.field.mean_deviation_t**2
    chi2, limit = float(np.sum(change**2 / variance)), quantile(FALSE_TOUCH, change.size)
    if chi2 < limit:
        raise RowError(
            f"the pad is not touched: the field differs from the untouched pad's by χ² = {chi2:.0f}, and noise alone "
            f"gives up to {limit:.0f}"
        )


@dataclass(frozen=True, slots=True)
class Unmoved:
    """Limits of an untouched pad's deviation from its baseline."""

    pad: Pad
    mounting: Mounting | ArrayMounting
    baseline_id: str
    moved_limit_m: float
    ambient_limit_t: float

    def require(self, unloaded: Averaged) -> None:
        """Raise RefusedError, with the deviation, where magnet or ambient field differ too much from the baseline."""
        again = "record the baseline again (fmfts-daemon baseline --rest), then go on"
        moved_m, ambient_change_t = self._since_baseline(unloaded)
        x, y, z = moved = moved_m * 1e3
        if not np.linalg.norm(moved) <= self.moved_limit_m * 1e3:
            raise RefusedError(
                f"the pad has moved, or something touches it: its magnet is ({x:+.3f}, {y:+.3f}, {z:+.3f}) mm away "
                f"from where baseline {self.baseline_id} found it (limit {self.moved_limit_m * 1e3:g} mm): {again}"
            )
        ambient_t = float(np.abs(ambient_change_t).max())
        if not ambient_t <= self.ambient_limit_t:
            raise RefusedError(
                f"the ambient field has changed by {ambient_t * 1e6:.1f} µT since baseline {self.baseline_id} (limit "
                f"{self.ambient_limit_t * 1e6:g} µT): was the pad turned, or steel moved? {again[0].upper()}{again[1:]}"
            )

    def _since_baseline(self, unloaded: Averaged) -> tuple[Array, Array]:
        """The movement (3,) of the magnet, or of the one that moved most, and the change (3,) of the ambient field."""
        mounting = self.mounting
        if isinstance(mounting, ArrayMounting):
            return moved_since(mounting, unloaded.field)
        field, deviation = mounting.magnet_field(unloaded.field.mean_t), unloaded.field.mean_deviation_t
        estimate = solve(field, mounting.mounted(self.pad), mounting.rest, deviation_t=deviation, free=FREE_FIELD)
        return estimate.position_m - mounting.rest.position_m, estimate.state.ambient_t
