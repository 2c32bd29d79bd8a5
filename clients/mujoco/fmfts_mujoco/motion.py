"""Reads how a real arm moved: where its hand was, as libfranka's state tells it, in a CSV file.

For example `data_set/*/robot_state.csv` of github.com/imanlab/proactive-slip-control (MIT): a Franka arm that carries a
box between two fingers, faster from file to file, and lets it slip in the last three.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from fmfts.pad import Array

COLUMNS = ("time", "ee_T_03", "ee_T_13", "ee_T_23")  # s; the hand's place in m
SMOOTH_S = 0.1  # the camera's clock paces the rows: their steps are no motion of the arm


def way_m(path: Path, period_s: float) -> Array:
    """How far the hand was from its first place, each period. ValueError with what is wrong with the file."""
    with path.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    try:
        told = np.array([[float(row[name]) for name in COLUMNS] for row in rows])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: needs a number in the columns {', '.join(COLUMNS)} of each row") from error
    if len(told) < 2 or not np.isfinite(told).all() or (np.diff(told[:, 0]) < 0.0).any():
        raise ValueError(f"{path}: needs two rows or more, with times that grow")
    time_s, away_m = told[:, 0] - told[0, 0], np.linalg.norm(told[:, 1:] - told[0, 1:], axis=1)
    half = round(SMOOTH_S / period_s)
    window = np.hanning(2 * half + 1)
    padded = np.pad(np.interp(np.arange(0.0, time_s[-1], period_s), time_s, away_m), 2 * half, mode="edge")
    return np.asarray(np.convolve(padded, window / window.sum(), mode="valid"))
