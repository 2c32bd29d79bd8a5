"""Reads the table of a simulated pad: the laboratory's `pad-model` makes the file (finite_elements/pad_file.py)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fmfts.common.reading import damage_told, open_regular, unreadable_told
from fmfts.config import PadConfig, SimulatedSource
from fmfts_simulation.mechanics import Mechanics
from fmfts_simulation.solved_table import standard_mechanics

FORMAT = "fmfts pad model 1"
MADE_FOR = ("magnet_diameter_m", "magnet_length_m")
REMEDY = "`fmfts-daemon pad-model -o FILE.npz` makes one"


class PadFileError(ValueError):
    """The file holds no pad model."""


def read_pad_file(path: Path) -> tuple[Mechanics, dict[str, Any]]:
    """The table, and the slab that it was made for, by the names of the laboratory's Slab.

    Raises OSError where the file cannot be read, PadFileError where it is not a pad model.
    """
    with (
        open_regular(path) as opened,
        damage_told(PadFileError, f"{path}: is not a pad model: {REMEDY}"),
        np.load(opened, allow_pickle=False) as file,
    ):
        if str(file["format"]) != FORMAT:
            raise ValueError(f"its format is {str(file['format'])!r}, not {FORMAT!r}")
        count, exponents, coefficient = int(file["count"]), file["exponents"], file["coefficient"]
        if count < 5 or coefficient.shape != (count + 2, count + 2, len(exponents), 5):
            raise ValueError("its table has another size than it says")
        if not np.all(np.isfinite(coefficient)):
            raise ValueError("its table contains NaN or infinity")
        first_m, spacing_m = float(file["first_m"]), float(file["spacing_m"])
        mechanics = Mechanics(first_m, spacing_m, count, float(file["largest_force_n"]), exponents, coefficient)
        slab = json.loads(str(file["slab"]))
        if not all(isinstance(slab[name], float) for name in MADE_FOR):
            raise ValueError("its magnet has no dimensions")
        return mechanics, slab


def mechanics_of(pad: PadConfig, source: SimulatedSource) -> Mechanics:
    """The table that the config names for `pad`. Raises ValueError where it cannot be used."""
    if source.mechanics == "standard":
        return standard_mechanics()
    with unreadable_told(ValueError, f"pad {pad.name!r}: {source.mechanics}"):
        mechanics, slab = read_pad_file(Path(source.mechanics))
    made_for = np.array([slab[name] for name in MADE_FOR]) * 1e3
    if not np.allclose(made_for, [pad.magnet.diameter_mm, pad.magnet.length_mm], rtol=1e-6):
        raise ValueError(
            f"pad {pad.name!r}: {source.mechanics}: was made for a magnet of {made_for[0]:g} × {made_for[1]:g} mm, not "
            f"of {pad.magnet.diameter_mm:g} × {pad.magnet.length_mm:g} mm as in [pad.magnet]: make it again"
        )
    return mechanics
