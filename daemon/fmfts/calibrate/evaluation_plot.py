"""Draws an evaluation: the errors over the pad, and the estimated force against the true one."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib.figure import Figure

from fmfts.calibrate.evaluate import Evaluation


def draw(evaluation: Evaluation, target: Path) -> None:
    """Write a PNG or SVG file, by the suffix of `target`. Raises OSError or ValueError where that fails."""
    press, found = evaluation.press[evaluation.in_range], evaluation.found[evaluation.in_range]
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    place, force = figure.subplots(1, 2)
    error = found - press
    arrows = place.quiver(
        press[:, 0], press[:, 1], error[:, 0], error[:, 1], press[:, 2], angles="xy", scale_units="xy", scale=1.0
    )
    figure.colorbar(arrows, ax=place, label="force (N)")
    place.set(xlabel="x (mm)", ylabel="y (mm)", title="from the pressed place to the found one", aspect="equal")
    force.errorbar(press[:, 2], found[:, 2], evaluation.deviation[evaluation.in_range, 2], fmt=".", alpha=0.6)
    longest = [0.0, float(max(press[:, 2].max(), found[:, 2].max()))]
    force.plot(longest, longest, color="black", linewidth=0.8)
    force.set(xlabel="pressed (N)", ylabel="found (N), ± one deviation", title=f"model {evaluation.model}")
    figure.savefig(target, dpi=120)
