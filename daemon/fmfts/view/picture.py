"""Draws a contact: the pad from above, and all its numbers beside it.

`python -m fmfts.view.picture OUT.svg` draws the first touch that a running daemon reports.
"""

from __future__ import annotations

import argparse
import io
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from fmfts.common import exit_codes
from fmfts.view.history import History
from fmfts.view.tally import displacement_text
from fmfts_client import Client, Contact, EndpointError, SchemaError, Status
from fmfts_client.endpoints import for_client

Places = Sequence[tuple[float, float]]

HALF_WIDTH_M = 0.020  # the bus does not tell the pad's size; a contact farther out is drawn at the edge
HALF_COLUMNS = 20  # a column is 1 mm wide; a row is twice as high
WIDTH, COMPACT_WIDTH = 77, 57  # columns of a picture with figures beside the surface
LEGEND = (("●", "contact"), ("▒", "magnet"), ("□", "sensor"))
FULL_BAR_N = 5.0
BAR_COLUMNS = 20
MAGNET_RADIUS_M = 0.002


def render_contact(
    contact: Contact,
    status: Status | None = None,
    rate_hz: float | None = None,
    arrival_s: float | None = None,
    compact: bool = False,
    width: int = WIDTH,
    sensors_m: Places = (),
    history: History | None = None,
) -> RenderableType:
    """The picture of one contact.

    status: adds the configured rate, and what the source is. rate_hz: as the listener counted it. arrival_s: age of the
    sample when its message arrived at the listener. compact: half as wide, for several pads. width: columns that there
    are; a narrow picture is compact, and a narrower one has its figures below the surface. sensors_m: x and y of each.
    """
    compact = compact or width < WIDTH
    half_columns = HALF_COLUMNS // 2 if compact else HALF_COLUMNS
    surface = _surface(contact, half_columns, sensors_m)
    figures = _figures(contact, status, rate_hz, arrival_s, history)
    table = Table.grid(padding=(0, 1))
    if width >= (COMPACT_WIDTH if compact else WIDTH):
        table.add_row(surface, figures)
    else:
        table.add_row(surface)
        table.add_row(figures)
    source = "" if status is None else f": {status.source}"
    title = Text(f"pad {contact.pad}{source}", no_wrap=True, overflow="ellipsis")
    return Panel.fit(
        table,
        title=title,
        subtitle=_legend(sensors_m, half_columns),
        border_style=_health_style(contact.health),
        padding=0,
    )


def _legend(sensors_m: Places, half_columns: int) -> Text:
    """What the marks mean, and how long 10 mm are in the picture."""
    entries = [f"{mark} {word}" for mark, word in LEGEND if sensors_m or word != "sensor"]
    scale = "├" + "─" * (half_columns // 2 - 1) + "┤ 10 mm"
    return Text("  ".join([*entries, scale]), no_wrap=True, overflow="ellipsis")


def tilt_deg(axis: tuple[float, float, float]) -> float:
    """Angle between the magnet's axis and the pad's normal, in degrees."""
    return math.degrees(math.atan2(math.hypot(axis[0], axis[1]), abs(axis[2])))


def force_text(contact: Contact) -> str:
    if contact.over_range:
        bound = "?" if contact.force_min_n is None else f"{contact.force_min_n:.2f}"
        return f"more than {bound} N"
    return _with_deviation(contact.force_n, contact.force_sd_n, 1.0, 2, "N")


def _with_deviation(value: float | None, deviation: float | None, scale: float, digits: int, unit: str) -> str:
    if value is None:
        return "–"
    spread = "" if deviation is None else f" ± {deviation * scale:.{digits}f}"
    return f"{value * scale:.{digits}f}{spread} {unit}"


def _health_style(health: str) -> str:
    return {"ok": "green", "degraded": "yellow"}.get(health, "red")


def _force_style(contact: Contact) -> str:
    force_n = contact.force_n or 0.0
    if contact.over_range:
        return "bold white on red"
    return "green" if force_n < 1.0 else "yellow" if force_n < 2.5 else "red"


def _surface(contact: Contact, half_columns: int, sensors_m: Places = ()) -> Text:
    """The pad from above: x to the right, y up."""
    column_m = HALF_WIDTH_M / half_columns
    cells: dict[tuple[int, int], tuple[str, str]] = {}
    for x_m, y_m in sensors_m:
        cells[round(x_m / column_m), round(y_m / (2 * column_m))] = ("□", "bright_black")
    if contact.pose is not None:
        x_m, y_m, _ = contact.pose.position_m
        cells |= dict.fromkeys(_disc(x_m, y_m, MAGNET_RADIUS_M, column_m), ("▒", "blue"))
    if contact.contact is not False and contact.x_m is not None and contact.y_m is not None:
        radius_m = 0.001 + 0.001 * min(contact.force_n or contact.force_min_n or 0.0, FULL_BAR_N)
        mark = ("▲" if contact.over_range else "●", _force_style(contact))
        cells |= dict.fromkeys(_disc(contact.x_m, contact.y_m, radius_m, column_m), mark)
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
    """Cells (column, row) of a disc, always with the cell of its centre."""
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


def _figures(
    contact: Contact,
    status: Status | None,
    rate_hz: float | None,
    arrival_s: float | None,
    history: History | None = None,
) -> Table:
    figures = Table.grid(padding=(0, 1))
    figures.add_column(style="bright_black", no_wrap=True)
    figures.add_column(no_wrap=False, min_width=23, max_width=23)
    figures.add_row("health", Text(contact.health, _health_style(contact.health)))
    if contact.reason:
        figures.add_row("", Text(contact.reason, "yellow" if contact.health == "ok" else "red"))
    figures.add_row("contact", {True: "yes", False: "no", None: "not known"}[contact.contact])
    figures.add_row("force", Text(force_text(contact), _force_style(contact)))
    figures.add_row("", _bar(contact))
    if history is not None:
        figures.add_row("past 10 s", Text(history.blocks(), "cyan"))
    for name, value, deviation in (("x", contact.x_m, contact.x_sd_m), ("y", contact.y_m, contact.y_sd_m)):
        figures.add_row(name, _with_deviation(value, deviation, 1e3, 2, "mm"))
    if contact.displacement_m is not None:
        figures.add_row("moved", displacement_text(contact))
    if contact.shear_x_n is not None and contact.shear_y_n is not None:
        figures.add_row("shear", f"{contact.shear_x_n:+.2f} {contact.shear_y_n:+.2f} N")
    _add_pose(figures, contact)
    figures.add_row("rate", "–" if rate_hz is None else _rate_text(rate_hz, status))
    sending_ms = (contact.t_publish_ns - contact.t_sample_ns) * 1e-6
    figures.add_row("latency", f"{sending_ms:.2f} ms to publish" if contact.t_sample_ns else "–")
    if arrival_s is not None and contact.t_sample_ns:
        figures.add_row("", f"{arrival_s * 1e3:.2f} ms to here")
    used = [str(sensor + 1) for sensor in range(8) if contact.sensors_ok >> sensor & 1]
    figures.add_row("sensors", " ".join(used) or "none")
    figures.add_row("", "–" if contact.temperature_c is None else f"{contact.temperature_c:.1f} °C")
    return figures


def _rate_text(rate_hz: float, status: Status | None) -> str:
    """rate_hz: of contacts, which are more than the frames with `publish = "sample"`."""
    if status is None:
        return f"{rate_hz:.1f} Hz"
    frames_hz, nominal_hz = status.rate_hz, status.rate_nominal_hz
    if rate_hz > 1.5 * nominal_hz and frames_hz is not None:
        return f"{frames_hz:.1f} of {nominal_hz:g} Hz, {rate_hz:.0f} contacts a second"
    return f"{rate_hz:.1f} of {nominal_hz:g} Hz"


def _add_pose(figures: Table, contact: Contact) -> None:
    pose = contact.pose
    if pose is None:
        figures.add_row("magnet", "–")
        return
    for name, value, deviation in zip("abc", pose.position_m, pose.position_sd_m, strict=True):
        figures.add_row(name, _with_deviation(value, deviation, 1e3, 3, "mm"))
    figures.add_row("tilt", f"{tilt_deg(pose.axis):.2f} ± {math.degrees(pose.axis_sd_rad):.2f}°")
    figures.add_row("remanence", _with_deviation(pose.remanence_t, pose.remanence_sd_t, 1.0, 3, "T"))


def _bar(contact: Contact) -> Text:
    force_n = contact.force_min_n if contact.over_range else contact.force_n
    filled = 0 if force_n is None else min(max(round(force_n / FULL_BAR_N * BAR_COLUMNS), 0), BAR_COLUMNS)
    return Text("█" * filled, _force_style(contact)) + Text("░" * (BAR_COLUMNS - filled), "bright_black")


def as_svg(renderable: RenderableType, title: str) -> str:
    """The picture as SVG, in the reader's own monospaced font: its page loads no font from the network."""
    console = Console(record=True, width=80, file=io.StringIO(), force_terminal=True)
    console.print(renderable)
    return re.sub(r"@font-face\s*\{[^}]*\}\s*", "", console.export_svg(title=title))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m fmfts.view.picture", description=__doc__)
    parser.add_argument("out", type=Path, help="the SVG file to write")
    parser.add_argument("--pad", default="demo")
    parser.add_argument(
        "--force-n", type=float, default=0.5, help="the lightest touch to draw (default: %(default)s N)"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="how long to wait for one (default: %(default)s)")
    options = parser.parse_args()
    try:
        with Client(options.pad) as client:
            contact = _first_touch(client, options.force_n, options.seconds)
            arrival_s = None if contact is None else contact.sample_age_s
            status, rate_hz = client.status, client.rate_hz
    except (EndpointError, SchemaError) as error:
        print(error, file=sys.stderr)
        return exit_codes.UNAVAILABLE
    if contact is None:
        print(f"pad '{options.pad}': no touch of {options.force_n} N in {options.seconds:g} s", file=sys.stderr)
        return exit_codes.UNAVAILABLE
    from fmfts.view.places import sensor_places  # it imports this module

    sensors_m = sensor_places(for_client()).get(options.pad, ())
    picture = render_contact(contact, status, rate_hz, arrival_s, sensors_m=sensors_m)
    options.out.write_text(as_svg(picture, "fmfts-daemon listen"), encoding="utf-8")
    return 0


def _first_touch(client: Client, force_n: float, seconds: float) -> Contact | None:
    started_ns = None
    for contact in client.contacts(timeout_s=seconds):
        started_ns = started_ns or contact.t_publish_ns
        if client.freq_ok and contact.valid and contact.contact and (contact.force_n or 0.0) >= force_n:
            return contact
        if contact.t_publish_ns - started_ns > seconds * 1e9:
            return None
    return None


if __name__ == "__main__":
    sys.exit(main())
