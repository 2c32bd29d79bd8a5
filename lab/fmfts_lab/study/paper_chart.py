"""The paper's figures, drawn from a study's rows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmfts_lab.study.harness import Row
from fmfts_lab.study.style import COLOURS, SMALL_PT, TEXT_PT, sheet

# Points outside the pad are drawn at its edge: the paper's answers at 1.28 T are centimetres to metres away.
PLACE_MM, FORCE_N = 22.0, 3.0
TRAININGS_ACROSS = 2
LABEL_COVERS = 3  # points below or above a label
ERRORS = {"trained_mse": "trained on", "left_out_mse": "left out"}


def training(rows: Sequence[Row]) -> Figure:
    """Figure 7, or 11: squared error during training."""
    curves = [row for row in rows if row["kind"] == "training"]
    cases = list(dict.fromkeys(str(row["case"]) for row in curves))
    lines = -(-len(cases) // TRAININGS_ACROSS)
    figure = sheet(2.7 * lines + 0.5, _told(curves, cases))
    grid = figure.subplots(lines, min(len(cases), TRAININGS_ACROSS), squeeze=False)
    for axes, case in zip(grid.flat, cases, strict=False):
        mine = [row for row in curves if row["case"] == case]
        size = [row["size"] for row in mine]
        last: dict[str, tuple[np.ndarray, str]] = {}
        for (key, name), colour, style in zip(ERRORS.items(), COLOURS, ("o-", "s--"), strict=False):
            error = np.array([row[key] for row in mine], dtype=float)
            axes.loglog(size, error, style, color=colour)
            last[name] = error[-LABEL_COVERS:], colour
        highest = max(last, key=lambda name: last[name][0][-1])
        for name, (errors, colour) in last.items():  # above or below the points that it covers, so on neither line
            is_above = name == highest
            y = errors.max() if is_above else errors.min()
            axes.annotate(name, (float(str(size[-1])), float(y)), (0, 5 if is_above else -5),
                          textcoords="offset points", ha="right", va="bottom" if is_above else "top",
                          color=colour, fontsize=TEXT_PT)  # fmt: skip
        axes.margins(y=0.15)
        axes.set_title(case, fontsize=TEXT_PT)
        axes.set_xlabel("neurons" if case.startswith("RBF") else "steps", fontsize=TEXT_PT)
        axes.set_ylabel("mean squared error", fontsize=TEXT_PT)
        axes.tick_params(labelsize=SMALL_PT)
    return figure


def _told(curves: Sequence[Row], cases: Sequence[str]) -> str:
    """In how many cases the error on other presses ends above its least."""
    errors = ([float(str(row["left_out_mse"])) for row in curves if row["case"] == case] for case in cases)
    rising = sum(error[-1] > min(error) for error in errors if error)
    return f"More training fits its own presses; on others the error rises again in {rising} of {len(cases)}"


def estimates(rows: Sequence[Row], cases: tuple[str, ...], remanences_t: tuple[float, ...]) -> Figure:
    """Figure 8: true and estimated places and forces, a column for each case, two lines for each remanence."""
    tests = [row for row in rows if row["kind"] == "test"]
    foot = "Black crosses: true places, with a line to the red dot that was found; beyond the pad, at its edge."
    figure = sheet(
        3.6 * len(remanences_t) + 0.8, "Places and forces, with the magnet trained on and with another", foot
    )
    grid = figure.subplots(2 * len(remanences_t), len(cases), squeeze=False)
    for index, (remanence_t, case) in enumerate(product(remanences_t, cases)):
        mine = [row for row in tests if (row["case"], row["remanence_t"]) == (case, remanence_t)]
        true, found = (
            np.array([[row[prefix + name] for name in ("x_mm", "y_mm", "force_n")] for row in mine], dtype=float)
            for prefix in ("", "found_")
        )
        pair, column = divmod(index, len(cases))
        places, forces = grid[2 * pair : 2 * pair + 2, column]
        _places(places, true, found)
        places.set_title(f"{case}\n{remanence_t} T", fontsize=TEXT_PT)
        _forces(forces, true, found)
        for axes in (places, forces):
            axes.tick_params(labelsize=SMALL_PT)
            axes.xaxis.label.set_size(SMALL_PT)
            axes.yaxis.label.set_size(SMALL_PT)
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
