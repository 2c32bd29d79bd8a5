"""The paper's figures, drawn from a study's rows."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmfts_lab.study.harness import Row

matplotlib.use("Agg")
# Points outside the pad are drawn at its edge: the paper's answers at 1.28 T are centimetres to metres away.
PLACE_MM, FORCE_N = 22.0, 3.0


def training(rows: Sequence[Row]) -> Figure:
    """Figure 7, or 11: squared error during training."""
    curves = [row for row in rows if row["kind"] == "training"]
    cases = list(dict.fromkeys(str(row["case"]) for row in curves))
    figure = Figure(figsize=(3.4 * len(cases), 3.2), layout="constrained")
    for axes, case in zip(np.atleast_1d(figure.subplots(1, len(cases))), cases, strict=True):
        mine = [row for row in curves if row["case"] == case]
        size = [row["size"] for row in mine]
        axes.loglog(size, [row["trained_mse"] for row in mine], "o-", label="trained on")
        axes.loglog(size, [row["left_out_mse"] for row in mine], "s--", label="left out")
        axes.set_title(case)
        axes.set_xlabel("neurons" if case.startswith("RBF") else "steps")
        axes.set_ylabel("mean squared error, ranges of ±1")
        axes.legend()
    return figure


def estimates(rows: Sequence[Row], cases: tuple[str, ...], remanences_t: tuple[float, ...]) -> Figure:
    """Figure 8: true and estimated places and forces, with a column for each case and remanence."""
    tests = [row for row in rows if row["kind"] == "test"]
    columns = [(case, remanence_t) for case in cases for remanence_t in remanences_t]
    figure = Figure(figsize=(2.6 * len(columns), 5.6), layout="constrained")
    grid = figure.subplots(2, len(columns))
    for index, (case, remanence_t) in enumerate(columns):
        mine = [row for row in tests if (row["case"], row["remanence_t"]) == (case, remanence_t)]
        true, found = (
            np.array([[row[prefix + name] for name in ("x_mm", "y_mm", "force_n")] for row in mine], dtype=float)
            for prefix in ("", "found_")
        )
        _places(grid[0, index], true, found)
        grid[0, index].set_title(f"{case}\n{remanence_t} T")
        _forces(grid[1, index], true, found)
    return figure


def _places(axes: Axes, true: np.ndarray, found: np.ndarray) -> None:
    shown = np.clip(found[:, :2], -PLACE_MM, PLACE_MM)
    axes.plot(np.stack([true[:, 0], shown[:, 0]]), np.stack([true[:, 1], shown[:, 1]]), color="0.7", lw=0.6)
    axes.plot(true[:, 0], true[:, 1], "k+", ms=4)
    axes.plot(shown[:, 0], shown[:, 1], "r.", ms=3)
    axes.set(xlim=(-PLACE_MM, PLACE_MM), ylim=(-PLACE_MM, PLACE_MM), aspect="equal", xlabel="x, mm", ylabel="y, mm")


def _forces(axes: Axes, true: np.ndarray, found: np.ndarray) -> None:
    axes.plot([0.0, FORCE_N], [0.0, FORCE_N], color="0.7", lw=0.6)
    axes.plot(true[:, 2], np.clip(found[:, 2], -FORCE_N, FORCE_N), "r.", ms=3)
    axes.set(xlim=(0.0, FORCE_N), ylim=(-FORCE_N, FORCE_N), xlabel="force, N", ylabel="found, N")
