"""Draws the board from above in plain text: each sensor at its place, and which way the field points in each step."""

from __future__ import annotations

import numpy as np

from fmfts_magnet.magnet import fields
from fmfts_magnet.readings import Array
from fmfts_magnet.verdict import Verdict
from fmfts_magnet.words import is_wrong

ARROWS = "→↗↑↖←↙↓↘"
CELL = 14
SHOWN = 0.38  # share of the field, sin 22.5°: less is not drawn
SAME_PLACE_M = 2e-3
LEGEND = (
    "Seen from the finger, +x to the right, +y up. In each step the field along the board (an arrow), and across it\n"
    "(⊙ toward you, ⊗ away). First what a sensor reads as the configuration has it; below, if not alike, what is due."
)


def picture(verdict: Verdict) -> str:
    board, count = verdict.board, len(verdict.board)
    seen = np.einsum("cij,kcj->kci", board.axes, verdict.readings.change_t)
    due = fields(board, verdict.found[0].fit.magnets)[0][0] if verdict.found else None
    columns, rows = _levels(board.place_m[:, 0]), _levels(board.place_m[:, 1])[::-1]
    grid = [[[" " * CELL] * 3 for _ in columns] for _ in rows]
    for sensor in range(count):
        row = int(np.abs(np.array(rows) - board.place_m[sensor, 1]).argmin())
        column = int(np.abs(np.array(columns) - board.place_m[sensor, 0]).argmin())
        read, expected = _arrows(seen[:, sensor]), "" if due is None else _arrows(due[:, sensor])
        wrong = verdict.dead[sensor].any() or not verdict.found or is_wrong(verdict.found[0].description, sensor)
        lines = [f"{sensor + 1} {'✗' if wrong else '✓'}", read, expected if wrong else ""]
        grid[row][column] = [line.center(CELL) for line in lines]
    drawn = [" ".join(cell[line] for cell in cells).rstrip() for cells in grid for line in range(4 - 1)]
    return "\n".join([LEGEND, "", *drawn])


def _levels(values: Array) -> list[float]:
    """Different values, those that are nearly alike only once."""
    found: list[float] = []
    for value in sorted(values.tolist()):
        if not found or value - found[-1] > SAME_PLACE_M:
            found.append(value)
    return found


def _arrows(field: Array) -> str:
    """field (K, 3): of each step."""
    words = []
    for x, y, z in np.nan_to_num(field):
        size = float(np.sqrt(x * x + y * y + z * z))
        along = ARROWS[round(float(np.arctan2(y, x)) / (np.pi / 4.0)) % 8] if np.hypot(x, y) > SHOWN * size else " "
        across = ("⊙" if z > 0.0 else "⊗") if abs(z) > SHOWN * size else " "
        words.append(f"{along}{across}" if size else "· ")
    return " ".join(words)
