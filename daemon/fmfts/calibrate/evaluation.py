"""How good a contact model is: errors by region, as a table and as facts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fmfts.calibrate.samples import Samples
from fmfts.contact.contract import ErrorTables
from fmfts.pad import Array

Predict = Callable[[Array], Array]
Row = dict[str, float | str]
Mask = NDArray[np.bool_]
ForceBins = tuple[float, ...]

UNITS = ("x_mm", "y_mm", "force_n", "shear_x_n", "shear_y_n")
CENTRE_MM, RELIABLE_MM = 8.0, 11.0
LIGHT_N, FIRM_N = 0.5, 1.2
FORCE_BINS = (0.025, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)  # ends, as shares of the largest force
RADIUS_BINS_MM = (4.0, 8.0, 11.0, 12.5, 14.0, 15.5, 17.0, 18.5, 20.0)
LEAST_ERROR = 1e-5
STEP = 1e-4  # of a pose in mm and of its axis: central differences of a smooth function


def regions(press: Array) -> Iterator[tuple[str, Mask]]:
    """Name and members (K,) of each region that holds a press."""
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
    """MAE and RMSE of `found` (K, m) against `press` (K, m) for each region; with deviations (K, m) also the rms of
    errors in deviations, which is 1 where these are honest."""
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


def printed(table: list[Row]) -> str:
    """The rows as aligned text, a header first."""
    columns = list(table[0])
    cells = [columns, *([str(row.get(column, "")) for column in columns] for row in table)]
    widths = [max(len(line[index]) for line in cells) for index in range(len(columns))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in cells)


def metrics(press: Array, found: Array) -> dict[str, float]:
    """The numbers of the first row: over all presses."""
    return {name: float(value) for name, value in rows(press, found)[0].items() if name not in ("region", "presses")}


def force_bins(largest_n: float) -> ForceBins:
    """Ends of the bins of force for a pad that is calibrated to `largest_n`."""
    inner = (float(f"{share * largest_n:.4g}") for share in FORCE_BINS[:-1])
    return (*inner, largest_n)


def own_error(predict: Predict, samples: Samples, noisy: Samples, bins: ForceBins) -> ErrorTables:
    """What remains of noise-free `samples`, by force and by distance from the centre; and, where it is more, what
    `noisy` ones err by beyond what the Jacobian carries over of the noise, where they are found. A network that was
    trained on noise answers the mean of what may have been: at the edge less than it was."""
    found = predict(noisy.pose)
    carried = np.einsum("kim,kij,kjm->km", by_pose := _slope(predict, noisy.pose), noisy.covariance, by_pose)
    still = _squares(bins, samples.press, (predict(samples.pose) - samples.press) ** 2)
    return _tables(bins, np.maximum(still, _squares(bins, found, (found - noisy.press) ** 2 - carried)))


def _slope(predict: Predict, pose: Array) -> Array:
    """(K, 5, m) of the answers to poses (K, 6), by their first five components."""
    steps = STEP * np.eye(5, 6)
    slope: Array = np.stack([(predict(pose + step) - predict(pose - step)) / (2.0 * STEP) for step in steps], axis=1)
    return slope


def tables_of_squares(bins: ForceBins, press: Array, square: Array) -> ErrorTables:
    """Root means of squared errors (K, m) in the bins of presses (K, m); a bin without any is as the
    nearest."""
    return _tables(bins, _squares(bins, press, square))


def _tables(bins: ForceBins, square: Array) -> ErrorTables:
    """From mean squares (forces, radii, m); shear has one table, of both its directions."""
    if square.shape[2] > 3:
        square = np.concatenate([square[:, :, :3], square[:, :, 3:].mean(axis=2, keepdims=True)], axis=2)
    root = np.maximum(np.round(np.sqrt(np.maximum(square, 0.0)), 5), LEAST_ERROR)
    tables = [tuple(tuple(row) for row in table.tolist()) for table in np.moveaxis(root, 2, 0)]
    return ErrorTables(bins, RADIUS_BINS_MM, *tables)


def _squares(bins: ForceBins, press: Array, square: Array) -> Array:
    """(forces, radii, m) means of (K, m) in the bins of presses (K, m); a bin without any is as the nearest."""
    radius_mm = np.hypot(press[:, 0], press[:, 1])
    row = np.minimum(np.searchsorted(bins, press[:, 2]), len(bins) - 1)
    column = np.minimum(np.searchsorted(RADIUS_BINS_MM, radius_mm), len(RADIUS_BINS_MM) - 1)
    means = np.empty((len(bins), len(RADIUS_BINS_MM), square.shape[1]))
    for i, j in product(range(len(bins)), range(len(RADIUS_BINS_MM))):
        nearest_row = row == _nearest(row, i)
        nearest = nearest_row & (column == _nearest(column[nearest_row], j))
        means[i, j] = square[nearest].mean(axis=0)
    return means


def _nearest(values: NDArray[np.intp], wanted: int) -> int:
    return int(values[np.argmin(np.abs(values - wanted))])


def rms(values: Array) -> float:
    return rounded(np.sqrt(np.mean(values**2)))


def rounded(value: float) -> float:
    return round(float(value), 5)
