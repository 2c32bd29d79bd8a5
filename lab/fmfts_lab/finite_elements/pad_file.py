"""Writes the table of a simulated pad, which fmfts_simulation/pad_file.py reads."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fmfts_lab.finite_elements.slab import Slab
from fmfts_simulation.mechanics import Mechanics
from fmfts_simulation.pad_file import FORMAT


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
