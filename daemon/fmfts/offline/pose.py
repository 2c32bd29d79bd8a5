"""`fmfts-daemon pose`: fields in a CSV file → poses in another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmfts import ambient
from fmfts.ambient import BaselineError, Mounting
from fmfts.offline.field_table import DataError, FieldTable
from fmfts.pad import Pad
from fmfts.pose import PoseEstimate, State, Status, solve

# The data sheet's noise of one sample at ±0.88 G: 2 mG.
NOISE_T = 2e-7


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """baseline: a file whose ambient field and gains apply, None where the table has neither. sequence: each row is
    started from the one before, not from rest. noise_t: standard deviation of a field value."""

    baseline: Path | None = None
    sequence: bool = False
    noise_t: float = NOISE_T


def solve_table(table: FieldTable, pad: Pad, options: PoseOptions) -> dict[str, list[str]]:
    """The table's other columns, then pose, remanence, residual and status, with a standard deviation for each."""
    mounting = None if options.baseline is None else _mounting(options.baseline, pad)
    geometry = pad if mounting is None else mounting.mounted(pad)
    start = State.at_rest(geometry) if mounting is None else mounting.rest
    rest = start
    estimates = []
    for measured in table.field_t:
        field = measured if mounting is None else mounting.magnet_field(measured)
        estimate = solve(field, geometry, start, deviation_t=options.noise_t)
        if options.sequence:
            start = estimate.state if estimate.status is Status.CONVERGED else rest
        estimates.append(estimate)
    return table.others | _columns(estimates)


def _mounting(path: Path, pad: Pad) -> Mounting:
    try:
        baseline = ambient.load(path, pad)
        if baseline is None:
            raise DataError(f"{path}: there is no such baseline")
        return baseline.mounting(pad)
    except BaselineError as error:
        raise DataError(str(error)) from error


def _columns(estimates: list[PoseEstimate]) -> dict[str, list[str]]:
    names = ("a_mm", "b_mm", "c_mm", "m", "n", "p", "remanence_t")
    columns: dict[str, list[str]] = {
        name: [] for name in (*names, "residual_ut", "status", *(f"{name}_sd" for name in names))
    }
    for estimate in estimates:
        solved = estimate.status is Status.CONVERGED
        values = (*(estimate.position_m * 1e3), *estimate.axis, estimate.remanence_t)
        deviations = _deviations(estimate)
        for name, value, deviation in zip(names, values, deviations, strict=True):
            columns[name].append(f"{value:.6f}" if solved else "")
            columns[f"{name}_sd"].append(f"{deviation:.6f}" if solved else "")
        columns["residual_ut"].append(f"{estimate.residual_t * 1e6:.6f}" if solved else "")
        columns["status"].append(estimate.status.value)
    return columns


def _deviations(estimate: PoseEstimate) -> list[float]:
    """Of a_mm … remanence_t. Where the residuals are larger than the noise, they tell the errors better than it."""
    freedom = max(estimate.degrees_of_freedom, 1)
    scale = np.sqrt(max(1.0, estimate.chi2 / freedom))
    deviation = np.sqrt(np.diagonal(estimate.pose_covariance)) * scale
    remanence = np.sqrt(estimate.covariance[5, 5]) * estimate.remanence_t * scale
    return [*(deviation[:3] * 1e3), *deviation[3:], float(remanence)]
