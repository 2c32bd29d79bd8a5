"""Writes and reads the table of a simulated pad: `pad-model` makes the file, a simulated source reads it with NumPy."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fmfts.common.reading import damage_told, open_regular, unreadable_told
from fmfts.config import PadConfig, SimulatedSource
from fmfts.simulation.mechanics import Mechanics
from fmfts.simulation.slab import Slab
from fmfts.simulation.solved_table import standard_mechanics

FORMAT = "fmfts pad model 1"
REMEDY = "`fmfts-daemon pad-model -o FILE.npz` makes one"


class PadFileError(ValueError):
    """The file holds no pad model."""


def write_pad_file(path: Path, mechanics: Mechanics, slab: Slab) -> None:
    """Write the file. Raises OSError."""
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            format=np.array(FORMAT),
            slab=np.array(json.dumps(asdict(slab))),
            first_m=np.array(mechanics.first_m),
            spacing_m=np.array(mechanics.spacing_m),
            count=np.array(mechanics.count),
            largest_force_n=np.array(mechanics.largest_force_n),
            exponents=mechanics.exponents,
            coefficient=mechanics.coefficient,
        )


def read_pad_file(path: Path) -> tuple[Mechanics, Slab]:
    """Read the file. Raises OSError where it cannot be read, PadFileError where it is not a pad model."""
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
        return mechanics, Slab(**json.loads(str(file["slab"])))


def mechanics_of(pad: PadConfig, source: SimulatedSource) -> Mechanics:
    """The table that the config names for `pad`. Raises ValueError where it cannot be used."""
    if source.mechanics == "standard":
        return standard_mechanics()
    with unreadable_told(ValueError, f"pad {pad.name!r}: {source.mechanics}"):
        mechanics, slab = read_pad_file(Path(source.mechanics))
    made_for = np.array([slab.magnet_diameter_m, slab.magnet_length_m]) * 1e3
    if not np.allclose(made_for, [pad.magnet.diameter_mm, pad.magnet.length_mm], rtol=1e-6):
        raise ValueError(
            f"pad {pad.name!r}: {source.mechanics}: was made for a magnet of {made_for[0]:g} × {made_for[1]:g} mm, not "
            f"of {pad.magnet.diameter_mm:g} × {pad.magnet.length_mm:g} mm as in [pad.magnet]: make it again"
        )
    return mechanics
