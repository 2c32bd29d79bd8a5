"""Wrong beliefs in an emulator are found without any driver: what the sources say is checked of the emulator alone.

Each belief here was held once, by driver and emulator alike, so that every test passed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from emulator import memsic, memsic_film, qst

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


BELIEFS: list[tuple[str, str, Any, str, Any]] = [
    ("mmc5983ma", "automatic set and reset takes 2 ms", memsic.Mmc5983ma, "measurement_s", one_sample_alone),
    ("mmc5983ma", "a reset pulse turns nothing over", memsic_film.Film, "pulse", set_alone),
    ("mmc5983ma", "a strong field leaves nothing behind", memsic_film.Memsic, "exposed", lambda *_: None),
    ("mmc5983ma", "all samples are alike", memsic.Mmc5983ma, "odd_gauss", 0.0),
    ("mmc5983ma", "a measurement may follow a pulse at once", memsic.Mmc5983ma, "settles_s", 1e-9),
    ("mmc5603nj", "it is an MMC5983MA: 10 ms for a reset", memsic.Mmc5603nj, "reset_s", 10e-3),
    ("mmc5603nj", "it is an MMC5983MA: 18 bits", memsic.Mmc5603nj, "counts_per_gauss", 4096),
    ("qmc5883p", "it converts as a QMC5883L does", qst.Qmc5883p, "convert", qst.Qmc5883l.convert),
]


def checked(kind: str) -> int:
    """How the checks of this emulator end."""
    options = ["-q", "-x", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist", "-o", "addopts="]
    return pytest.main([*options, str(HERE / f"test_emulated_{kind}.py")])


@pytest.mark.parametrize("kind", ["mmc5983ma", "mmc5603nj", "qmc5883p"])
def test_emulator_with_the_sources_facts_passes(kind: str) -> None:
    assert checked(kind) == pytest.ExitCode.OK


@pytest.mark.parametrize(
    ("kind", "belief", "where", "name", "wrong"), BELIEFS, ids=[f"{b[0]}: {b[1]}" for b in BELIEFS]
)
def test_emulator_with_a_wrong_belief_is_caught(
    monkeypatch: pytest.MonkeyPatch, kind: str, belief: str, where: Any, name: str, wrong: Callable[..., Any] | float
) -> None:
    assert hasattr(where, name)
    monkeypatch.setattr(where, name, wrong)
    assert checked(kind) == pytest.ExitCode.TESTS_FAILED, f"nothing notices an emulated {kind} that believes: {belief}"
