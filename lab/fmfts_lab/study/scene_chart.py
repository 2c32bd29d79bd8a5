"""Noise and bias of every model of a scene, side by side."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from fmfts_lab.study.harness import Row

matplotlib.use("Agg")


def models(rows: Sequence[Row], recommended: str) -> Figure:
    found = [row for row in rows if row["kind"] == "model"]
    names = [("► " if row["model"] == recommended else "") + str(row["model"]) for row in found]
    height = np.arange(len(found))[::-1]
    figure = Figure(figsize=(10.0, 0.4 * len(found) + 1.4), layout="constrained")
    for axes, unit, what in zip(
        figure.subplots(1, 2, sharey=True), ("mm", "n"), ("place, mm", "force, N"), strict=True
    ):
        for kind, shift, colour in (("noise", 0.18, "tab:blue"), ("bias", -0.18, "tab:red")):
            values = np.array([row[f"{kind}_{unit}"] for row in found], dtype=float)
            axes.barh(height + shift, np.maximum(values, 1e-5), 0.34, color=colour, label=kind)
        axes.set_xscale("log")
        axes.set_xlabel(f"rms over presses: {what}")
        axes.set_yticks(height, names)
        axes.legend()
    return figure
