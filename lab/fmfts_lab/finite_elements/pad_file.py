"""Writes the table of a simulated pad, which simulation/pad_file.py of the daemon reads."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fmfts.simulation.mechanics import Mechanics
from fmfts.simulation.pad_file import FORMAT
from fmfts_lab.finite_elements.slab import Slab


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
