"""Recordings of real boards, which this repository does not hold: tests that use them are skipped without them."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
FOLDER = Path(os.environ.get("FMFTS_RECORDED") or ROOT.parent / "shared/recorded")


def needs(name: str) -> Path:
    """The file of this name; without it the test is skipped."""
    path = FOLDER / name
    if not path.is_file():
        pytest.skip(f"{path} is absent (FMFTS_RECORDED names its folder)")
    return path


def eflesh_fields_ut(name: str) -> np.ndarray:
    """(K, 5, 3): the fields of the first five chips in eFlesh's recording, microtesla as published."""
    with needs(name).open(newline="") as file:
        header, *rows = csv.reader(file)
    columns = [number for number, column in enumerate(header) if column.endswith("_ut")][:15]
    return np.array([[float(row[column]) for column in columns] for row in rows]).reshape(-1, 5, 3)
