"""`fmfts-daemon pose`: solves the pose of each row of a CSV file of fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmfts.pad import Array, Pad
from fmfts.pose import (
    AMBIENT,
    FREE_FIELD,
    FREE_PAPER,
    FREE_POSE,
    LOG_MOMENT,
    SIZE,
    PoseEstimate,
    Prior,
    State,
    Status,
    parts_of,
    solve,
)
from fmfts.pose.neighbour import NeighbourEstimate
from fmfts.pose.state import GRADIENT
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.field_table import FieldTable, mounting_of, read
from fmfts_calibrate.field_units import require_unit
from fmfts_calibrate.neighbours import joined, their_magnets, with_rest

POSE_NAMES = ("a_mm", "b_mm", "c_mm", "m", "n", "p", "remanence_t")
AMBIENT_NAMES = ("ambient_x_ut", "ambient_y_ut", "ambient_z_ut")
UNKNOWNS = {5: FREE_POSE, 6: FREE_PAPER, 8: FREE_FIELD, 9: np.union1d(FREE_PAPER, FREE_FIELD)}


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """baseline: a file with the ambient field and the gains; None: the table's fields need neither. sequence: start
    each row from the previous pose, not from rest. noise_t: standard deviation of a field value.

    unknowns: the pose alone (5), with the moment (6, the paper's), with the ambient field (8), with both (9). octupole:
    model the magnet as a cylinder. gradient_t_per_m: standard deviation of the ambient field's gradient about zero.
    neighbours: magnets of other pads, whose field at rest was subtracted with the ambient field.
    """

    baseline: Path | None = None
    sequence: bool = False
    noise_t: float = NOISE_T
    unknowns: int = 6
    octupole: bool = False
    gradient_t_per_m: float = 0.0
    neighbours: Sequence[NeighbourEstimate] = ()


def read_fields(path: Path, pad: Pad) -> FieldTable:
    """The table at `path`. Raises DataError where it cannot be read, or its fields are in another unit than µT."""
    table = read(path, len(pad.sensors))
    require_unit(path, table, pad)
    return table


def solve_table(table: FieldTable, pad: Pad, options: PoseOptions) -> dict[str, list[str]]:
    """The table's other columns, then pose, remanence, residual and status, with standard deviations.

    The ambient field is added where it is unknown. Raises DataError where the baseline cannot be used.
    """
    mounting = None if options.baseline is None else mounting_of(options.baseline, pad)
    geometry = pad if mounting is None else mounting.mounted(pad)
    rest = State.at_rest(geometry) if mounting is None else mounting.rest
    start, estimates = rest, []
    for measured in table.field_t:
        field = measured if mounting is None else mounting.magnet_field(measured)
        estimate = _solve(with_rest(field, geometry.sensors, options.neighbours), geometry, start, options)
        if options.sequence:
            converged = estimate.status is Status.CONVERGED
            start = replace(estimate.state, neighbours=()) if converged else rest
        estimates.append(estimate)
    with_ambient = AMBIENT.start in UNKNOWNS[options.unknowns]
    return table.others | _columns(estimates, POSE_NAMES + AMBIENT_NAMES if with_ambient else POSE_NAMES)


def _solve(field_t: Array, pad: Pad, start: State, options: PoseOptions) -> PoseEstimate:
    spread = np.zeros(SIZE)
    spread[GRADIENT] = options.gradient_t_per_m
    parts = parts_of(free=UNKNOWNS[options.unknowns], prior=np.flatnonzero(spread))
    start, parts, prior = joined(start, parts, Prior(start, np.diag(spread**2)), options.neighbours)
    return solve(
        field_t,
        pad,
        start,
        deviation_t=options.noise_t,
        parts=parts,
        prior=prior,
        octupole=options.octupole,
        neighbours=their_magnets(options.neighbours),
    )


def _columns(estimates: list[PoseEstimate], names: Sequence[str]) -> dict[str, list[str]]:
    columns: dict[str, list[str]] = {
        name: [] for name in (*names, "residual_ut", "status", *(f"{name}_sd" for name in names))
    }
    for estimate in estimates:
        converged = estimate.status is Status.CONVERGED
        state = estimate.state
        values = (*(state.position_m * 1e3), *state.axis, estimate.remanence_t, *(state.ambient_t * 1e6))
        for name, value, deviation in zip(names, values, _deviations(estimate), strict=False):
            columns[name].append(f"{value:.6f}" if converged else "")
            columns[f"{name}_sd"].append(f"{deviation:.6f}" if converged else "")
        columns["residual_ut"].append(f"{estimate.residual_t * 1e6:.6f}" if converged else "")
        columns["status"].append(estimate.status.value)
    return columns


def _deviations(estimate: PoseEstimate) -> list[float]:
    """Standard deviations of a_mm … ambient_z_ut, scaled up where the residuals are larger than the noise."""
    freedom = max(estimate.degrees_of_freedom, 1)
    scale = np.sqrt(max(1.0, estimate.chi2 / freedom))
    pose = np.sqrt(np.diagonal(estimate.pose_covariance)) * scale
    remanence = np.sqrt(estimate.covariance[LOG_MOMENT, LOG_MOMENT]) * estimate.remanence_t * scale
    ambient = np.sqrt(np.diagonal(estimate.covariance)[AMBIENT]) * scale
    return [*(pose[:3] * 1e3), *pose[3:], float(remanence), *(ambient * 1e6)]
