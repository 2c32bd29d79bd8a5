"""The commented configuration that ships, and the one that `fmfts-daemon init` makes of it for a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

EXAMPLE_PATH = Path(__file__).with_name("example.toml")
ARRAY_PATH = Path(__file__).with_name("array.toml")  # the second standard pad
FIRST_PAD = "# One [[pad]] table for each pad."
GEOMETRY, OTHER_SOURCES = "[pad.geometry]", "# --- A pad behind an STM32 board"
# The keys of a further pad; the first pad's comments explain the others.
SHORT_GEOMETRY = "[pad.geometry]\nsensors_mm = [[8, 8, 0], [8, -8, 0], [-8, 8, 0], [-8, -8, 0]]"
SHARED_KEYS = ("rate_hz", "range_gauss", "trigger", "publish", "chip")
COLLECTING = "# --- The machine and the gauge"


@dataclass(frozen=True, slots=True)
class FoundPad:
    """A pad that answered. source: the lines of its [pad.source]. sensors: how many chips it has. places: where, for
    people. other_half: the pad before it that is behind the same mux of a board, "": none is.
    """

    name: str
    source: Sequence[str]
    sensors: int
    places: str = ""
    other_half: str = ""


# Tolerances of a sketch: 2 mm and 10° anywhere, as standard deviations (a number within ±1 has 1/√3).
ROUGH = {
    "sensor_position_mm": ("1.2", "of each sensor: a sketch, 2 mm off at most, that `baseline --learn` makes exact"),
    "sensor_rotation_deg": ("6.0", "of each chip about each axis: 10° off at most"),
}


def written_for(pads: Sequence[FoundPad], where: str, is_sketch: bool = False) -> str:
    """The text of a configuration for these pads; where: says where they were found. Comments are the example's.

    is_sketch: the geometry was not measured.
    """
    text = EXAMPLE_PATH.read_text(encoding="utf-8")
    general, rest = text.split(FIRST_PAD, 1)
    sections = rest[rest.index(GEOMETRY) : rest.index(OTHER_SOURCES)].rstrip()
    collecting = text[text.index(COLLECTING) :]
    short = SHORT_GEOMETRY
    if is_sketch:
        sections, short = _roughly(sections), f"{short}\n\n[pad.tolerance]\n{_rough_lines()}"
    blocks = [_pad(pad, sections if number == 0 else short) for number, pad in enumerate(pads)]
    head = f"# Written by `fmfts-daemon init` for {where}.\n# Compare [pad.geometry] and [pad.magnet] with your pad.\n"
    return head + general + "\n\n".join(blocks) + "\n\n" + collecting


def _roughly(sections: str) -> str:
    lines = [_rough_line(line.partition(" = ")[0]) or line for line in sections.splitlines()]
    return "\n".join(lines)


def _rough_lines() -> str:
    return "\n".join(filter(None, map(_rough_line, ROUGH)))


def _rough_line(key: str) -> str | None:
    if key not in ROUGH:
        return None
    value, comment = ROUGH[key]
    return f"{key} = {value}".ljust(31) + f"# {comment}"


def unusual(pad: FoundPad) -> str | None:
    """A hint if a pad has not the standard four chips, or may be half of one; else None."""
    if pad.other_half:
        return (
            f"{pad.other_half} and {pad.name} are behind one mux. Where their eight sensors are one pad "
            f"(docs/several.md), give {pad.other_half} eight sensors_mm, and remove {pad.name}"
        )
    if pad.sensors == 4:
        return None
    if pad.sensors == 8:
        return (
            f"{pad.name}: 8 chips found ({pad.places}), as the second standard pad has: its sensors_mm and magnets are "
            "in docs/several.md"
        )
    chips = "1 chip" if pad.sensors == 1 else f"{pad.sensors} chips"
    return (
        f"{pad.name}: {chips} found ({pad.places}), and a standard pad has 4: look for a chip that answers elsewhere "
        "(another channel of the mux, the same address as another chip) or not at all (supply, SDA and SCL); then "
        "remove this file and type `init` again. If your pad is like that, fill in its sensors_mm"
    )


def shared_lines() -> list[str]:
    """The keys that every device has, with their comments."""
    text = EXAMPLE_PATH.read_text(encoding="utf-8")
    lines: list[str] = []
    is_shared = False
    for line in text[: text.index(GEOMETRY)].splitlines():
        if not line.startswith(" "):  # otherwise the line continues the comment before it
            is_shared = line.partition(" = ")[0] in SHARED_KEYS
        if is_shared:
            lines.append(line)
    return lines


def _pad(pad: FoundPad, sections: str) -> str:
    named = f'[[pad]]\nname = "{pad.name}"' + " " * max(1, 23 - len(pad.name)) + f"# the topic is contact/{pad.name}"
    return "\n".join([named, "", "[pad.source]", *pad.source, "", _with_sensors(sections, pad.sensors)]).rstrip()


def _with_sensors(sections: str, count: int) -> str:
    """For another number of sensors than the example's four the places are unknown: `check-config` demands them."""
    if count == 4:
        return sections
    lines = sections.splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("sensors_mm = "))
    lines[at] = f"sensors_mm = []               # FILL IN: the places of this pad's {count} sensors"
    return "\n".join(lines)
