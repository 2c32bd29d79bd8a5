"""Draws a contact: the pad from above, and all its numbers beside it."""

from __future__ import annotations

import math

from rich.console import RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from fmfts.view.surface import FULL_BAR_N, Places, force_style, surface
from fmfts.view.tally import displacement_text
from fmfts_client import Contact, Finger, Pose, Status

HALF_COLUMNS = 20  # a column is 1 mm wide; a row is twice as high
WIDTH, COMPACT_WIDTH = 77, 57  # columns of a picture with figures beside the surface
LEGEND = (("●", "contact"), ("▒", "magnet"), ("□", "sensor"))
BAR_COLUMNS = 20


def render_contact(
    contact: Contact,
    status: Status | None = None,
    rate_hz: float | None = None,
    arrival_s: float | None = None,
    compact: bool = False,
    width: int = WIDTH,
    sensors_m: Places = (),
) -> RenderableType:
    """The picture of one contact.

    status: adds the configured rate, and what the source is. rate_hz: as the listener counted it. arrival_s: age of the
    sample when its message arrived at the listener. compact: half as wide, for several pads. width: columns that there
    are; a narrow picture is compact, and a narrower one has its figures below the surface. sensors_m: x and y of each.
    """
    compact = compact or width < WIDTH
    half_columns = HALF_COLUMNS // 2 if compact else HALF_COLUMNS
    seen = surface(contact, half_columns, sensors_m)
    figures = _figures(contact, status, rate_hz, arrival_s)
    table = Table.grid(padding=(0, 1))
    if width >= (COMPACT_WIDTH if compact else WIDTH):
        table.add_row(seen, figures)
    else:
        table.add_row(seen)
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
    """The meaning of the marks, and the length of 10 mm in the picture."""
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


def _figures(
    contact: Contact,
    status: Status | None,
    rate_hz: float | None,
    arrival_s: float | None,
) -> Table:
    figures = Table.grid(padding=(0, 1))
    figures.add_column(style="bright_black", no_wrap=True)
    figures.add_column(no_wrap=False, min_width=23, max_width=23)
    figures.add_row("health", Text(contact.health, _health_style(contact.health)))
    if contact.reason:
        figures.add_row("", Text(contact.reason, "yellow" if contact.health == "ok" else "red"))
    figures.add_row("contact", {True: "yes", False: "no", None: "not known"}[contact.contact])
    figures.add_row("force", Text(force_text(contact), force_style(contact)))
    figures.add_row("", _bar(contact))
    if contact.more:
        figures.add_row("", Text("two fingers do not explain this", "yellow"))
    if contact.contacts:
        for finger in contact.contacts:
            _add_finger(figures, finger)
    else:
        _add_place(figures, contact)
    if contact.displacement_m is not None:
        figures.add_row("moved", displacement_text(contact))
    if contact.poses:
        for number, pose in enumerate(contact.poses, 1):
            figures.add_row(f"magnet {number}", " ".join(f"{value * 1e3:.2f}" for value in pose.position_m) + " mm")
    else:
        _add_pose(figures, contact.pose)
    figures.add_row("rate", "–" if rate_hz is None else _rate_text(rate_hz, status))
    sending_ms = (contact.t_publish_ns - contact.t_sample_ns) * 1e-6
    figures.add_row("latency", f"{sending_ms:.2f} ms to publish" if contact.t_sample_ns else "–")
    if arrival_s is not None and contact.t_sample_ns:
        figures.add_row("", f"{arrival_s * 1e3:.2f} ms to here")
    used = [str(sensor + 1) for sensor in range(contact.sensors_ok.bit_length()) if contact.sensors_ok >> sensor & 1]
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


def _add_place(figures: Table, contact: Contact) -> None:
    for name, value, deviation in (("x", contact.x_m, contact.x_sd_m), ("y", contact.y_m, contact.y_sd_m)):
        figures.add_row(name, _with_deviation(value, deviation, 1e3, 2, "mm"))
    _add_shear(figures, contact)


def _add_finger(figures: Table, finger: Finger) -> None:
    figures.add_row(f"finger {finger.id}", _with_deviation(finger.force_n, finger.force_sd_n, 1.0, 2, "N"))
    figures.add_row("", f"x {finger.x_m * 1e3:+.1f}, y {finger.y_m * 1e3:+.1f} mm")
    _add_shear(figures, finger)


def _add_shear(figures: Table, touch: Contact | Finger) -> None:
    if touch.shear_x_n is not None and touch.shear_y_n is not None:
        figures.add_row("shear", f"{touch.shear_x_n:+.2f} {touch.shear_y_n:+.2f} N")


def _add_pose(figures: Table, pose: Pose | None) -> None:
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
    return Text("█" * filled, force_style(contact)) + Text("░" * (BAR_COLUMNS - filled), "bright_black")
