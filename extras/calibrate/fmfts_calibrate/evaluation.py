"""Computes the errors of a contact model by region, by force and by distance from the centre."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fmfts.contact.contract import ErrorTables
from fmfts.pad import Array
from fmfts_calibrate.samples import Samples

Predict = Callable[[Array], Array]
Row = dict[str, float | str]
Mask = NDArray[np.bool_]
ForceBins = tuple[float, ...]

UNITS = ("x_mm", "y_mm", "force_n", "shear_x_n", "shear_y_n")
CENTRE_MM, RELIABLE_MM = 8.0, 11.0
LIGHT_N, FIRM_N = 0.5, 1.2
FORCE_BINS = (0.025, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)  # upper ends, as shares of the largest force
RADIUS_BINS_MM = (4.0, 8.0, 11.0, 12.5, 14.0, 15.5, 17.0, 18.5, 20.0)
LEAST_ERROR = 1e-5
HONEST, WRONG = 2.0, 5.0  # deviations
COVERAGE = "within_2, beyond_5: share of errors within two, and beyond five, of the stated deviations"
STEP = 1e-4  # step of central differences, for a pose's position in mm and for its axis


def regions(press: Array) -> Iterator[tuple[str, Mask]]:
    """(name, members (K,)) of each region that contains a press."""
    radius, force = np.hypot(press[:, 0], press[:, 1]), press[:, 2]
    named = (
        ("all", radius >= 0.0),
        (f"within {CENTRE_MM:g} mm", radius <= CENTRE_MM),
        (f"{CENTRE_MM:g} to {RELIABLE_MM:g} mm", (radius > CENTRE_MM) & (radius <= RELIABLE_MM)),
        (f"beyond {RELIABLE_MM:g} mm", radius > RELIABLE_MM),
        (f"below {LIGHT_N:g} N", force < LIGHT_N),
        (f"{LIGHT_N:g} to {FIRM_N:g} N", (force >= LIGHT_N) & (force < FIRM_N)),
        (f"from {FIRM_N:g} N", force >= FIRM_N),
    )
    return ((name, members) for name, members in named if members.any())


def rows(press: Array, found: Array, deviation: Array | None = None) -> list[Row]:
    """MAE and RMSE of the answers `found` (K, m) against `press` (K, m), for each region.

    deviation (K, m): adds the rms of error / deviation, which is 1 where the deviations are right.
    """
    error = found - press
    out: list[Row] = []
    for name, members in regions(press):
        row: Row = {"region": name, "presses": int(members.sum())}
        for column in range(error.shape[1]):
            row[f"mae_{UNITS[column]}"] = rounded(np.abs(error[members, column]).mean())
        for column in range(error.shape[1]):
            row[f"rmse_{UNITS[column]}"] = rms(error[members, column])
        if deviation is not None:
            for column in range(error.shape[1]):
                row[f"in_sd_{UNITS[column]}"] = rms(error[members, column] / deviation[members, column])
        out.append(row)
    return out


def firm_and_central(press: Array, found: Array) -> str:
    """A sentence with the mean errors in the region of docs/limits.md's figures; "" without a press there."""
    chosen = (np.hypot(press[:, 0], press[:, 1]) <= RELIABLE_MM) & (press[:, 2] >= LIGHT_N)
    if not chosen.any():
        return ""
    error = np.abs(found - press)[chosen]
    x_mm, y_mm, force_n = error.mean(axis=0)[:3]
    return (
        f"of these, within {RELIABLE_MM:g} mm of the centre and from {LIGHT_N:g} N, "
        "as the figures of docs/limits.md, mean errors: "
        f"x {x_mm:.2f} mm, y {y_mm:.2f} mm, force {force_n:.3f} N;\n"
        "lighter touches and the rim, where a place changes the field less, make the rest of `all`"
    )


def printed(table: list[Row]) -> str:
    """The rows as aligned text with a header."""
    columns = list(table[0])
    cells = [columns, *([str(row.get(column, "")) for column in columns] for row in table)]
    widths = [max(len(line[index]) for line in cells) for index in range(len(columns))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in cells)


def metrics(press: Array, found: Array) -> dict[str, float]:
    """MAE and RMSE over all presses."""
    return {name: float(value) for name, value in rows(press, found)[0].items() if name not in ("region", "presses")}


def force_bins(largest_n: float) -> ForceBins:
    """Upper ends of the force bins of a pad that is calibrated up to `largest_n`."""
    inner = (float(f"{share * largest_n:.4g}") for share in FORCE_BINS[:-1])
    return (*inner, largest_n)


def own_error(predict: Predict, samples: Samples, noisy: Samples, bins: ForceBins) -> ErrorTables:
    """The model's own error, by force and by distance from the centre.

    It is the error without noise (`samples`), or, where that is larger, the error of `noisy` samples beyond what the
    Jacobian predicts from their noise, in the bin of the answer: a network that was trained on noise answers the mean
    of all possible presses, which is too small at the edge.
    """
    found = predict(noisy.pose)
    from_noise = np.einsum("kim,kij,kjm->km", by_pose := _slope(predict, noisy.pose), noisy.covariance, by_pose)
    noise_free = _squares(bins, samples.press, (predict(samples.pose) - samples.press) ** 2)
    return _tables(bins, np.maximum(noise_free, _squares(bins, found, (found - noisy.press) ** 2 - from_noise)))


def _slope(predict: Predict, pose: Array) -> Array:
    """(K, 5, m) derivatives of the answers by the first five components of poses (K, 6)."""
    steps = STEP * np.eye(5, 6)
    slope: Array = np.stack([(predict(pose + step) - predict(pose - step)) / (2.0 * STEP) for step in steps], axis=1)
    return slope


def tables_of_squares(bins: ForceBins, press: Array, square: Array) -> ErrorTables:
    """Roots of the mean `square` (K, m) in the bins of presses (K, m). An empty bin takes the value of the nearest."""
    return _tables(bins, _squares(bins, press, square))


def _tables(bins: ForceBins, square: Array) -> ErrorTables:
    """The tables of mean squares (forces, radii, m); both directions of shear share one table."""
    if square.shape[2] > 3:
        square = np.concatenate([square[:, :, :3], square[:, :, 3:].mean(axis=2, keepdims=True)], axis=2)
    root = np.maximum(np.round(np.sqrt(np.maximum(square, 0.0)), 5), LEAST_ERROR)
    tables = [tuple(tuple(row) for row in table.tolist()) for table in np.moveaxis(root, 2, 0)]
    return ErrorTables(bins, RADIUS_BINS_MM, *tables)


def _squares(bins: ForceBins, press: Array, square: Array) -> Array:
    """(forces, radii, m) means of (K, m) in the bins of presses (K, m). An empty bin takes the value of the nearest."""
    radius_mm = np.hypot(press[:, 0], press[:, 1])
    row = np.minimum(np.searchsorted(bins, press[:, 2]), len(bins) - 1)
    column = np.minimum(np.searchsorted(RADIUS_BINS_MM, radius_mm), len(RADIUS_BINS_MM) - 1)
    means = np.empty((len(bins), len(RADIUS_BINS_MM), square.shape[1]))
    for i, j in product(range(len(bins)), range(len(RADIUS_BINS_MM))):
        nearest_row = row == _nearest(row, i)
        nearest = nearest_row & (column == _nearest(column[nearest_row], j))
        means[i, j] = square[nearest].mean(axis=0)
    return means


def _nearest(values: NDArray[np.intp], target: int) -> int:
    return int(values[np.argmin(np.abs(values - target))])


def rms(values: Array) -> float:
    return rounded(np.sqrt(np.mean(values**2)))


def rounded(value: float) -> float:
    return round(float(value), 5)
