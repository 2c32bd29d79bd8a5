"""`make chips-page`: writes docs/chips.md from the chips' descriptions, and from what each is worth at the shipped pad."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.file import load
from fmfts.contact import ContactModel
from fmfts.scene import Surroundings
from fmfts.sensor.chips import CHIPS, Chip
from fmfts_lab.study.harness import Row
from fmfts_lab.study.scene_chips import chip_rows

PAGE = Path(__file__).parents[3] / "docs" / "chips.md"
HEAD = """# The chips

For who chooses magnetometers for a new pad, or has some and asks whether they will do. This page is made from the code
(`make chips-page`): a test fails where they differ.

**For a new pad take the MMC5983MA**, four of them behind a TCA9548A, with `trigger = "simultaneous"`: it is made, its noise is
the smallest, and it holds fields of 8 G. The QMC5883L is as good as the HMC5983 was, costs least, and is what boards sold as HMC5883L
carry. The MLX90393 needs no mux and is on boards that you may own; its noise is seven times as large.

Set `chip`, `rate_hz` and `range_gauss` in `[pad.source]`; `fmfts-daemon probe` names a chip that is not the one you set.
Today the chips beside the HMC run on Linux I2C (`type = "i2c"`) and in the simulation; boards read HMC chips only.

## What each can do
"""
WORTH = """
## What each is worth at the shipped pad

The Cramér–Rao bound of one frame, rms over presses all over the pad: a magnet of 2 × 2 mm, 12 mm above four chips, 0.3 to
2 N. Each chip at 220 Hz or as near as it comes, with one trigger for all where that is quieter, and at the best rate that it
and a bus of 400 kHz allow four of them. "Mean": the place's error in the mean of the frames of 1/220 s. `fmfts-daemon study scene --chips --config FILE` says it for your pad.
"""
FOOT = """
## What the drivers do about each chip's own traps

| chip | trap | what the driver does |
|---|---|---|
| QMC5883L | sold as HMC5883L: other address, registers, byte order and scale | recognises it by its identification at 0x0D; `probe` says `set chip = "qmc5883l"` |
| QMC5883L | its overflow flag is of all axes together | marks the axis that shows the last count; all three where none does |
| QMC5883L | after a reset it answers with zeros | takes only samples that it calls ready |
| LIS3MDL | beyond its full scale nothing is promised | marks an axis beyond ±4, 8, 12 or 16 G as saturated |
| LIS3MDL | temperature read on from the axes repeats x | reads it in a transfer of its own |
| LIS3MDL | shares 0x1E with the HMC5983 | tells them by WHO_AM_I and by `H43` |
| MMC5983MA | a field of more than 10 G leaves it magnetised | a set pulse before every measurement |
| MMC5983MA | "done" stays until it is cleared | clears it before it reads the axes, so that no sample is lost or taken twice |
| MMC5983MA | its settings cannot be read back | resets it first; a chip that was reset delivers nothing, and is set up again |
| MLX90393 | RES 0 and 1 wrap around: a field beyond the range reads as another field | RES 2 alone, where the converter's own end is reached first |
| MLX90393 | OSR 0 with DIG_FILT 0 or 1 never ends with HALLCONF 0xC | uses DIG_FILT 2 to 7 |
| MLX90393 | registers cannot be read in a burst | leaves the burst to set it up; afterwards the status tells whether it is still in one |
| MLX90393 | upper bits of register 0 are the factory's | keeps them |

How it is tested: every driver runs on an emulation of its chip, register by register, that was written from the data sheet
and not from the driver (`tests/emulator/magnetometers.py`, `mlx90393.py`). `tests/unit/test_driver_mutations.py` lists wrong
drivers that these tests catch. None was measured on hardware: "unverified" marks what no data sheet at hand told.
"""


def page() -> str:
    config = load(EXAMPLE_PATH)[0].pad[0]
    response = ContactModel.load("default", config.pad()).response
    assert response is not None, "the shipped model holds one"
    worth = list(chip_rows(Surroundings(config, response)))
    return HEAD + "\n" + _abilities() + WORTH + "\n" + _worth(worth) + FOOT


def _abilities() -> str:
    columns = ("chip", "ranges, G", "step, mG", "noise, mG, at rates, Hz", "at the host's word", "temperature",
               "self-test", "addresses", "supply, price of a board")  # fmt: skip
    rows = (
        (
            f"{chip.label}<br>`{chip.name}`",
            ", ".join(f"±{each:g}" for each in chip.ranges_gauss),
            _steps(chip),
            _noises(chip),
            f"{chip.single_conversion_s * 1e3:.3g} ms" if chip.has_trigger else "no",
            "no" if chip.thermometer is None else f"{chip.thermometer.c_per_count:.2g} °C a step",
            "no" if chip.bias_strap is None else f"gains to ±{chip.bias_strap.deviation:.1%}",
            ", ".join(f"0x{each:02X}" for each in chip.addresses),
            chip.supply,
        )
        for chip in CHIPS.values()
    )
    remarks = "".join(f"- {chip.label}: {chip.remarks}.\n" for chip in CHIPS.values())
    return _table(columns, rows) + "\n" + remarks


def _steps(chip: Chip) -> str:
    """Of the finest range: one figure, or two where z differs."""
    steps = sorted({f"{1e3 / counts:.2g}" for counts in chip.counts_per_gauss[0]})
    return " / ".join(steps)


def _noises(chip: Chip) -> str:
    rates = [rate for rate in chip.output_rates_hz if rate <= chip.free_rate_hz and rate >= 20.0]
    noises = [f"{chip.noise_at_t(rate, 'free') * 1e7:.2g}" for rate in rates]
    if len(set(noises)) == 1:
        return f"{noises[0]} up to {rates[-1]:g}"
    return ", ".join(f"{noise} at {rate:g}" for noise, rate in zip(noises, rates, strict=True))


def _worth(rows: Sequence[Row]) -> str:
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
    )
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
            )
            for row in rows
        ),
    )


def _float(value: object) -> float:
    assert isinstance(value, float | np.floating)
    return float(value)


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
