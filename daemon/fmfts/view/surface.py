"""Draws the pad from above as text: x to the right, y up."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich.text import Text

from fmfts_client import Contact

Places = Sequence[tuple[float, float]]

HALF_WIDTH_M = 0.020  # the pad's size is not on the bus; a contact farther out is drawn at the edge
FULL_BAR_N = 5.0
MAGNET_RADIUS_M = 0.002


def force_style(contact: Contact) -> str:
    force_n = contact.force_n or 0.0
    if contact.over_range:
        return "bold white on red"
    return "green" if force_n < 1.0 else "yellow" if force_n < 2.5 else "red"


def surface(contact: Contact, half_columns: int, sensors_m: Places = ()) -> Text:
    """The pad from above: x to the right, y up."""
    column_m = HALF_WIDTH_M / half_columns
    cells: dict[tuple[int, int], tuple[str, str]] = {}
    for x_m, y_m in sensors_m:
        cells[round(x_m / column_m), round(y_m / (2 * column_m))] = ("□", "bright_black")
    for pose in contact.poses or filter(None, [contact.pose]):
        x_m, y_m, _ = pose.position_m
        cells |= dict.fromkeys(_disc(x_m, y_m, MAGNET_RADIUS_M, column_m), ("▒", "blue"))
    mark = ("▲" if contact.over_range else "●", force_style(contact))
    for x_m, y_m, force_n, number in _touches(contact):
        disc = _disc(x_m, y_m, 0.001 + 0.001 * min(force_n, FULL_BAR_N), column_m)
        cells |= dict.fromkeys(disc, mark)
        if number:
            cells[disc[-1]] = (number, f"{mark[1]} reverse")
    text = Text()
    half_rows = half_columns // 2
    for row in range(half_rows, -half_rows - 1, -1):
        for column in range(-half_columns, half_columns + 1):
            text.append(*cells.get((column, row), (_ground(column, row, half_columns), "bright_black")))
        text.append("\n" if row > -half_rows else "")
    return text


def _ground(column: int, row: int, half_columns: int) -> str:
    """The background: a cross in the middle, and dots every 10 mm in a full picture."""
    if column == row == 0:
        return "+"
    return "·" if column % (half_columns // 2) == 0 and row % (half_columns // 4) == 0 else " "


def _disc(x_m: float, y_m: float, radius_m: float, column_m: float) -> list[tuple[int, int]]:
    """Cells (column, row) of a disc; the last one is its centre."""
    half_columns = round(HALF_WIDTH_M / column_m)
    middle = round(x_m / column_m), round(y_m / (2 * column_m))
    column = min(max(middle[0], -half_columns), half_columns)
    row = min(max(middle[1], -half_columns // 2), half_columns // 2)
    reach = math.ceil(radius_m / column_m)
    near = [
        (column + i, row + j)
        for i in range(-reach, reach + 1)
        for j in range(-reach, reach + 1)
        if math.hypot(i * column_m, 2 * j * column_m) <= radius_m
        and abs(column + i) <= half_columns
        and abs(row + j) <= half_columns // 2
    ]
    return [*near, (column, row)]


def _touches(contact: Contact) -> Iterator[tuple[float, float, float, str]]:
    """Place, force and mark of each known finger, else of the contact as one."""
    if contact.contacts is not None:
        for finger in contact.contacts:
            yield finger.x_m, finger.y_m, finger.force_n, str(finger.id % 10)  # one cell; the figures have all digits
    elif contact.contact is not False and contact.x_m is not None and contact.y_m is not None:
        yield contact.x_m, contact.y_m, contact.force_n or contact.force_min_n or 0.0, ""
