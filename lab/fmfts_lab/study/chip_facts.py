"""The facts of each chip, with where they come from: values from its description, sources from chip_facts.toml."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fmfts.common.toml import parse
from fmfts.sensor.chips import CHIPS, Chip

SOURCES = Path(__file__).with_name("chip_facts.toml")
GRADES = ("S", "D", "one", "U", "unverified")


class Fact(NamedTuple):
    chip: Chip
    fact: str
    value: str
    grade: str
    source: str


def facts() -> Iterator[Fact]:
    """ValueError where a fact lacks its source, or a source its fact."""
    sources = parse(SOURCES.read_text(encoding="utf-8"))
    for chip in (each for each in CHIPS.values() if not each.streamed):
        values = {fact: value for fact, show in _SHOWN.items() if (value := show(chip))}
        known = sources.get(chip.name, {})
        if values.keys() != known.keys():
            raise ValueError(
                f"{SOURCES.name}, [{chip.name}]: not the facts of the chip: {values.keys() ^ known.keys()}"
            )
        for fact, value in values.items():
            grade, source = known[fact]
            if grade not in GRADES:
                raise ValueError(f"{SOURCES.name}, [{chip.name}] {fact}: the grade {grade!r} is none of {GRADES}")
            yield Fact(chip, fact, value, grade, source)


def _selftest(chip: Chip) -> str:
    if chip.bias_strap is not None:
        low, high = chip.bias_strap.limits
        return f"{low} to {high} counts of {chip.bias_strap.field_gauss[0]:g} and {chip.bias_strap.field_gauss[2]:g} G"
    if chip.set_reset is not None:
        return f"zero within ±{chip.set_reset.largest_zero_gauss:g} G, coil over {chip.set_reset.least_coil_gauss:g} G"
    if chip.own_field is not None:
        return "own field of " + ", ".join(f"{low} to {high}" for low, high in chip.own_field.limits) + " counts"
    return ""


def _film(chip: Chip) -> str:
    film = chip.film
    if film is None:
        return ""
    return (
        f"set pulse at set-up, after {film.upset_gauss:g} G, every {film.every_s:g} s; pause {film.pause_s * 1e3:g} ms"
    )


def _noise(chip: Chip) -> str:
    noises = sorted({*chip.noises_t, chip.noise_t})
    return " to ".join(dict.fromkeys(f"{each * 1e7:.2g}" for each in (noises[0], noises[-1]))) + " mG"


def _rates(chip: Chip) -> str:
    rates = "the host's, " if chip.paced_by_host else ""
    return f"{rates}up to {chip.free_rate_hz} Hz"


def _time(chip: Chip) -> str:
    if not chip.has_trigger:
        return "no trigger"
    return f"{chip.single_conversion_s * 1e3:.3g} ms, read after {chip.single_wait_s * 1e3:.3g} ms"


_SHOWN: dict[str, Callable[[Chip], str]] = {
    "address": lambda chip: f"0x{chip.address:02X}",
    "identity": lambda chip: chip.identity.hex(" "),
    "registers": lambda chip: f"`{type(chip.driver).__module__.rsplit('.', 1)[1]}.py`",
    "axes": lambda chip: "left-handed" if np.prod(np.sign(chip.counts_per_gauss[0])) < 0 else "right-handed",
    "counts": lambda chip: ", ".join(f"{abs(counts[0]):.5g}" for counts in chip.counts_per_gauss) + " a gauss",
    "rates": _rates,
    "time": _time,
    "clock": lambda chip: f"±{chip.clock_tolerance:.0%}",
    "noise": _noise,
    "warmth": lambda chip: f"{chip.sensitivity_per_k:+.2%} of a count a kelvin",
    "thermometer": lambda chip: "" if chip.thermometer is None else f"{chip.thermometer.c_per_count:.2g} °C a count",
    "film": _film,
    "selftest": _selftest,
}
