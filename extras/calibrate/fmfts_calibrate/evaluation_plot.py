"""Draws an evaluation: the errors over the pad, and the estimated force against the true one."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts_calibrate.evaluate import Evaluation
from fmfts_calibrate.evaluation import RELIABLE_MM

LONGEST_MM = 4.0  # longest arrow, on the axes of a pad of 40 mm
FACTORS = (1, 2, 5, 10, 20, 50)


def magnification(press: Array, error: Array) -> int:
    """How many times as long as the errors (K, 2) arrows are drawn, so that most near the centre can be seen."""
    inner = np.hypot(*error[np.hypot(press[:, 0], press[:, 1]) <= RELIABLE_MM].T)
    usual = float(np.median(inner)) if len(inner) else LONGEST_MM
    return max((factor for factor in FACTORS if factor * usual <= LONGEST_MM / 2.0), default=1)


def shortened(arrows: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Arrows (K, 2) of at most LONGEST_MM, and which of them were longer."""
    length = np.hypot(*arrows.T)
    cut: NDArray[np.bool_] = np.asarray(length > LONGEST_MM, dtype=np.bool_)
    return arrows * np.where(cut, LONGEST_MM / np.maximum(length, LONGEST_MM), 1.0)[:, None], cut


def draw(evaluation: Evaluation, target: Path) -> None:
    """Write a PNG or SVG file, by the suffix of `target`. Raises OSError or ValueError where that fails."""
    press, found = evaluation.press[evaluation.in_range], evaluation.found[evaluation.in_range]
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    place, force = figure.subplots(1, 2)
    error = (found - press)[:, :2]
    factor = magnification(press, error)
    drawn, cut = shortened(factor * error)
    arrows = place.quiver(
        *press[:, :2].T, *drawn.T, press[:, 2], angles="xy", scale_units="xy", scale=1.0, width=0.004, minlength=0.0
    )
    place.plot(*press[cut, :2].T, "o", color="none", markeredgecolor="black", markersize=4)
    figure.colorbar(arrows, ax=place, label="force (N)")
    title = "from the pressed place toward the found one" + (f", {factor} times as long" if factor > 1 else "")
    if cut.any():
        title += f"\nringed: cut at an error of {LONGEST_MM / factor:g} mm"
    place.set(xlabel="x (mm)", ylabel="y (mm)", title=title, aspect="equal")
    force.errorbar(press[:, 2], found[:, 2], evaluation.deviation[evaluation.in_range, 2], fmt=".", alpha=0.6)
    longest = [0.0, float(max(press[:, 2].max(), found[:, 2].max()))]
    force.plot(longest, longest, color="black", linewidth=0.8)
    force.set(xlabel="pressed (N)", ylabel="found (N), ± one deviation", title=f"model {evaluation.model}")
    figure.savefig(target, dpi=120)
