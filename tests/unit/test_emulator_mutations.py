"""Wrong facts in an emulator are found without any driver: the checks compare the emulator alone with the sources.

Driver and emulator once shared the wrong facts about MMC5983MA, MMC5603NJ, QMC5883P and the first one about MLX90393
and QMC5883L, so that every test passed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from emulator import lis3mdl, memsic, memsic_film, mlx90393, qst

pytestmark = pytest.mark.mutation

HERE = Path(__file__).parent


def one_sample_alone(chip: Any) -> float:
    """Automatic set and reset costs no time."""
    chip.sample_s = chip.measurements_s[chip.controls[1] & 3]
    chip.automatic = False
    return float(chip.sample_s)


def set_alone(film: Any, polarity: int, time_s: float, repeatability_gauss: float) -> None:
    """Reset frees the film as set does, and turns nothing over."""
    film.polarity, film.upset, film.pulsed_s = 1, False, time_s
    film.zero_gauss = [0.0, 0.0, 0.0]


def valid_at_once(chip: Any, command: int, axes: int) -> bytes:
    """The first measurement after a reset is valid although nobody read its status."""
    chip.acknowledged = True
    return RIGHT_OBEYED(chip, command, axes)


def awake(chip: Any) -> None:
    """The identity answers as soon as the power is on."""
    chip.reset({0x0D: 0xFF})
    chip.woken = True


def kept_by_reading(chip: Any, register: int) -> int:
    """Reading an output leaves the sample new."""
    return int(chip.registers[register])


def at_the_end(chip: Any, *_: float) -> Any:
    """Each axis is measured when the conversion ends."""
    return RIGHT_FIELD_DURING(chip, chip.converted_s, chip.converted_s)


def always_on(chip: Any) -> None:
    """The pointer advances without the top bit of the register's number."""
    chip.pointer |= 0x80
    RIGHT_ADVANCE(chip)


def on_to_the_temperature(chip: Any) -> None:
    """After the last output comes the thermometer."""
    if chip.pointer & 0x80:
        chip.pointer = 0x80 | (chip.number() + 1) & 0x7F


RIGHT_OBEYED, RIGHT_FIELD_DURING = mlx90393.Mlx90393.obeyed, mlx90393.Mlx90393.field_during
RIGHT_ADVANCE = lis3mdl.Lis3mdl.advance
TABLE_TIME = property(lambda _: 1.0, lambda *_: None)  # whatever a test sets
BELIEFS: list[tuple[str, str, Any, str, Any]] = [
    ("mmc5983ma", "automatic set and reset takes 2 ms", memsic.Mmc5983ma, "measurement_s", one_sample_alone),
    ("mmc5983ma", "a reset pulse turns nothing over", memsic_film.Film, "pulse", set_alone),
    ("mmc5983ma", "a strong field leaves nothing behind", memsic_film.Memsic, "exposed", lambda *_: None),
    ("mmc5983ma", "all samples are alike", memsic.Mmc5983ma, "odd_gauss", 0.0),
    ("mmc5983ma", "a measurement may follow a pulse at once", memsic.Mmc5983ma, "settles_s", 1e-9),
    ("mmc5603nj", "it is an MMC5983MA: 10 ms for a reset", memsic.Mmc5603nj, "reset_s", 10e-3),
    ("mmc5603nj", "it is an MMC5983MA: 18 bits", memsic.Mmc5603nj, "counts_per_gauss", 4096),
    ("qmc5883p", "it converts as a QMC5883L does", qst.Qmc5883p, "convert", qst.Qmc5883l.convert),
    ("mlx90393", "the first status after a reset need not be read", mlx90393.Mlx90393, "obeyed", valid_at_once),
    ("mlx90393", "all axes are measured at once", mlx90393.Mlx90393, "field_during", at_the_end),
    ("mlx90393", "a slow part takes the table's time", mlx90393.Mlx90393, "slowness", TABLE_TIME),
    ("magnetometers", "a QMC5883L identifies itself at once", qst.Qmc5883l, "power_on", awake),
    ("magnetometers", "reading a QMC5883L leaves its sample new", qst.Qmc5883l, "value", kept_by_reading),
    ("magnetometers", "a LIS3MDL advances without the top bit", lis3mdl.Lis3mdl, "advance", always_on),
    ("magnetometers", "a LIS3MDL goes on to its temperature", lis3mdl.Lis3mdl, "advance", on_to_the_temperature),
]  # fmt: skip


def checked(kind: str) -> int:
    """The results of this emulator's checks."""
    options = ["-q", "-x", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist", "-o", "addopts="]
    return pytest.main([*options, str(HERE / f"test_emulated_{kind}.py")])


@pytest.mark.parametrize("kind", ["mmc5983ma", "mmc5603nj", "qmc5883p", "mlx90393", "magnetometers"])
def test_emulator_with_the_sources_facts_passes(kind: str) -> None:
    assert checked(kind) == pytest.ExitCode.OK


@pytest.mark.parametrize(
    ("kind", "belief", "where", "name", "wrong"), BELIEFS, ids=[f"{b[0]}: {b[1]}" for b in BELIEFS]
)
def test_faulty_emulator_is_caught(
    monkeypatch: pytest.MonkeyPatch, kind: str, belief: str, where: Any, name: str, wrong: Callable[..., Any] | float
) -> None:
    assert hasattr(where, name)
    monkeypatch.setattr(where, name, wrong)
    assert checked(kind) == pytest.ExitCode.TESTS_FAILED, f"nothing notices an emulated {kind} that believes: {belief}"
