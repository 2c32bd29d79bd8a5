"""`make chips-page`: the tables of two pages, from the chips' descriptions and their worth at the shipped pad."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.file import load
from fmfts.contact import ContactModel
from fmfts.sensor.chips import CHIPS, Chip
from fmfts_lab.scene import Surroundings
from fmfts_lab.study.chip_facts import facts
from fmfts_lab.study.harness import Row
from fmfts_lab.study.scene_chips import chip_rows

ROOT = Path(__file__).parents[3]
PAGES = {ROOT / "docs/chips.md": ("abilities", "worth"), ROOT / "lab/results/chip-facts.md": ("sources",)}
# Each of these tables stands between such lines; the rest of the page is written by hand.
BEGIN, END = "<!-- {}, made by `make chips-page`: begin -->\n", "<!-- end -->\n"


def page(text: str, tables: Sequence[str]) -> str:
    """The page with these tables made anew. ValueError where it lacks their marks."""
    makers = {"abilities": _abilities, "worth": _worth, "sources": _sources}
    for name in tables:
        begin = BEGIN.format(name)
        before, after = text[: text.index(begin)], text[text.index(END, text.index(begin)) :]
        text = f"{before}{begin}{makers[name]()}{after}"
    return text


def _abilities() -> str:
    columns = ("chip", "ranges, G", "step, mG", "noise, mG, at rates, Hz", "time of a triggered one",
               "age of a free one, ms, at rates, Hz", "temperature", "self-test", "addresses",
               "supply, price of a board")  # fmt: skip
    rows = (
        (
            f"{chip.label}<br>`{chip.name}`",
            ", ".join(f"±{each:g}" for each in chip.ranges_gauss),
            _steps(chip),
            _noises(chip),
            f"{chip.single_conversion_s * 1e3:.3g} ms" if chip.has_trigger else "no",
            _ages(chip),
            "no" if chip.thermometer is None else f"{chip.thermometer.c_per_count:.2g} °C a step",
            _selftest(chip),
            _addresses(chip),
            chip.supply,
        )
        for chip in CHIPS.values()
        if not chip.streamed
    )
    remarks = "".join(
        f"- {chip.label}: {chip.remarks}.\n" for chip in CHIPS.values() if chip.remarks and not chip.streamed
    )
    return _table(columns, rows) + "\n" + remarks


def _addresses(chip: Chip) -> str:
    """Shortens three or more addresses in a row to the first and the last."""
    first, last = chip.addresses[0], chip.addresses[-1]
    if len(chip.addresses) > 2 and chip.addresses == tuple(range(first, last + 1)):
        return f"0x{first:02X} to 0x{last:02X}"
    return ", ".join(f"0x{each:02X}" for each in chip.addresses)


def _sources() -> str:
    rows = ((fact.chip.label, fact.fact, fact.value, f"**{fact.grade}** {fact.source}") for fact in facts())
    return _table(("chip", "fact", "as the driver has it", "source"), rows)


def _selftest(chip: Chip) -> str:
    if chip.bias_strap is not None:
        return f"gains to ±{chip.bias_strap.deviation:.1%}"
    if chip.set_reset is not None:
        return "zeros and broken axes, on I2C"
    return "no" if chip.own_field is None else "broken axes, on I2C"


def _steps(chip: Chip) -> str:
    """The steps of the finest range: one figure, or two if z differs."""
    steps = sorted({f"{1e3 / abs(counts):.2g}" for counts in chip.counts_per_gauss[0]})
    return " / ".join(steps)


def _noises(chip: Chip) -> str:
    rates = [rate for rate in chip.output_rates_hz if rate <= chip.free_rate_hz and rate >= 20.0]
    noises = [f"{chip.noise_at_t(rate, 'free') * 1e7:.2g}" for rate in rates]
    if len(set(noises)) == 1:
        return f"{noises[0]} up to {rates[-1]:g}"
    return ", ".join(f"{noise} at {rate:g}" for noise, rate in zip(noises, rates, strict=True))


def _ages(chip: Chip) -> str:
    """The largest mean age: half a period until a frame takes the sample, and half a conversion, at most a period."""
    rates = [rate for rate in chip.output_rates_hz if 70.0 <= rate <= chip.free_rate_hz]
    return ", ".join(f"{1e3 / rate:.2g} at {rate:g}" for rate in rates)


def _worth() -> str:
    config = load(EXAMPLE_PATH)[0].pad[0]
    response = ContactModel.load("default", config.pad()).response
    assert response is not None, "the shipped model holds one"
    rows: list[Row] = list(chip_rows(Surroundings(config, response)))
    columns = (
        "chip",
        "trigger",
        "rate, Hz",
        "noise, µT",
        "range, G",
        "place, mm",
        "force, N",
        "mean, mm",
        "saturation; wiring",
        "unverified facts",
    )
    unverified = {chip.label: _unverified(chip) for chip in CHIPS.values()}
    return _table(
        columns,
        (
            (
                str(row["chip"]),
                str(row["trigger"]),
                str(row["rate_hz"]),
                f"{_float(row['noise_ut']):.2f}",
                "none" if row["range_gauss"] is None else f"±{row['range_gauss']:g}",
                f"{_float(row['noise_mm']):.2f}",
                f"{_float(row['noise_n']):.3f}",
                f"{_float(row['mean_mm']):.2f}",
                str(row["causes"]),
                unverified[str(row["chip"])],
            )
            for row in rows
        ),
    )


def _unverified(chip: Chip) -> str:
    grades = [fact.grade for fact in facts() if fact.chip is chip]
    return f"{grades.count('unverified')} of {len(grades)}"


def _float(value: object) -> float:
    assert isinstance(value, float | np.floating)
    return float(value)


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    for place, tables in PAGES.items():
        place.write_text(page(place.read_text(encoding="utf-8"), tables), encoding="utf-8")
