"""A picture of a pad's table: how far and in which direction 1 N at each place moves the magnet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fmfts_simulation.mechanics import Mechanics

POINTS, ARROWS = 61, 15
FORCE_N = 1.0


def draw(mechanics: Mechanics, target: Path) -> None:
    """Write a PNG, SVG or PDF, by the name's suffix. OSError or ValueError if that fails."""
    figure = Figure(figsize=(11, 4.8), layout="constrained")
    depth, tilt = figure.subplots(1, 2)
    reach_mm = -mechanics.first_m * 1e3
    for axes, title, unit in ((depth, "the magnet sinks", "mm"), (tilt, "the magnet tilts", "mrad")):
        place_mm, displacement_mm, axis = _pressed(mechanics, reach_mm, POINTS)
        tilt_mrad = np.hypot(axis[..., 0], axis[..., 1]) * 1e3
        values = -displacement_mm[..., 2] if axes is depth else tilt_mrad
        image = axes.pcolormesh(place_mm, place_mm, values.T, shading="gouraud", rasterized=True)
        figure.colorbar(image, ax=axes, label=unit)
        coarse_mm, displacement_mm, axis = _pressed(mechanics, reach_mm, ARROWS)
        across = displacement_mm if axes is depth else axis
        axes.quiver(coarse_mm, coarse_mm, across[..., 0].T, across[..., 1].T, color="white", alpha=0.7)
        axes.set(xlabel="x of the press (mm)", ylabel="y (mm)", aspect="equal", title=f"{title} under {FORCE_N:g} N")
    figure.savefig(target, dpi=120)


def _pressed(mechanics: Mechanics, reach_mm: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n,) in mm along x and y, displacements (n, n, 3) in mm, axes (n, n, 3)."""
    place_mm = np.linspace(-reach_mm, reach_mm, count)
    x, y = (each.ravel() * 1e-3 for each in np.meshgrid(place_mm, place_mm, indexing="ij"))
    displacement_m, axis = mechanics.displacement(x, y, np.full(x.size, FORCE_N))
    return place_mm, displacement_m.reshape(count, count, 3) * 1e3, axis.reshape(count, count, 3)
