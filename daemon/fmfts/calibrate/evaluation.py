"""How good a contact model is: errors by region, as a table and as facts."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from fmfts.calibrate.samples import Samples
from fmfts.contact.contract import ErrorTables
from fmfts.pad import Array

Predict = Callable[[Array], Array]
Row = dict[str, float | str]
Mask = NDArray[np.bool_]

UNITS = ("x_mm", "y_mm", "force_n", "shear_x_n", "shear_y_n")
CENTRE_MM, RELIABLE_MM = 8.0, 11.0
LIGHT_N, FIRM_N = 0.5, 1.2
FORCE_BINS_N = (0.05, 0.1, 0.2, 0.4, 0.8, 1.4, 2.0)
RADIUS_BINS_MM = (4.0, 8.0, 12.0, 20.0)


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


def own_error(predict: Predict, samples: Samples) -> ErrorTables:
    """What remains of noise-free `samples`, by force and by distance from the centre."""
    return error_tables(samples.press, predict(samples.pose) - samples.press)


def error_tables(press: Array, error: Array) -> ErrorTables:
    """Rms of errors (K, m) in the bins of presses (K, m); a radius that no press had is as good as the one within.

    ValueError where a force has no press at all near the centre.
    """
    radius_mm = np.hypot(press[:, 0], press[:, 1])
    row = np.minimum(np.searchsorted(FORCE_BINS_N, press[:, 2]), len(FORCE_BINS_N) - 1)
    column = np.minimum(np.searchsorted(RADIUS_BINS_MM, radius_mm), len(RADIUS_BINS_MM) - 1)

    def table(values: Array) -> tuple[tuple[float, ...], ...]:
        bins: list[list[float]] = [[] for _ in FORCE_BINS_N]
        for i, of_force in enumerate(bins):
            for j in range(len(RADIUS_BINS_MM)):
                inside = values[(row == i) & (column == j)]
                of_force.append(of_force[-1] if len(inside) == 0 and j else _rms_of_bin(inside))
        return tuple(tuple(of_force) for of_force in bins)

    shear = table(np.sqrt(np.mean(error[:, 3:] ** 2, axis=1))) if error.shape[1] > 3 else None
    x_mm, y_mm, force_n = (table(error[:, column]) for column in range(3))
    return ErrorTables(FORCE_BINS_N, RADIUS_BINS_MM, x_mm, y_mm, force_n, shear)


def rms(values: Array) -> float:
    return rounded(np.sqrt(np.mean(values**2)))


def rounded(value: float) -> float:
    return round(float(value), 5)


def _rms_of_bin(values: Array) -> float:
    if len(values) == 0:
        raise ValueError("no samples in a bin of the model's own error: draw more")
    return max(rms(values), 1e-5)
