"""`probe --magnet` where the configuration names a published board: the board is that one, or another one.

The true boards are those of published_boards.py, typed from the pick-and-place file and the firmwares, not from
config/layouts.py. The field is that of tests/unit/magnet_world.py.
"""

from __future__ import annotations

import re
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from magnet_mistakes import mirrored_chip, mirrored_pad, obeyed, quarter, scaled
from magnet_world import Built, Person, person
from published_boards import chips

from fmfts.config import GeometryConfig, PadConfig
from fmfts.config.file import load
from fmfts.config.layouts import BoardName
from fmfts_magnet import Readings, Verdict, sentences
from fmfts_magnet.geometry import NotWritableError, keys_of
from fmfts_magnet.verb import judged_pad, offer
from fmfts_skin.settings import AnyskinSource

NAMES = get_args(BoardName)
CONFIG = """[[pad]]
name = "skin"
[pad.source]
type = "anyskin"
port = "/dev/ttyACM0"
[pad.geometry]
board = "anyskin5"
[pad.contact]
model = "none"
"""
AS_CONFIGURED = ["Places, axes, signs and scales are as the configuration says."]


def built_as(name: str) -> Built:
    place_mm, axes = chips(name)
    return Built(place_mm * 1e-3, axes, np.arange(5), np.tile(np.eye(3), (5, 1, 1)), np.ones((5, 3)))


def readings_of(built: Built, seed: Any) -> tuple[Readings, Person]:
    random = np.random.default_rng(seed)
    someone = person("mlx90393", random)
    return obeyed(built, "mlx90393", someone, random), someone


def verdict_of(configured: str, readings: Readings, pole: int) -> Verdict:
    source = AnyskinSource(port="/dev/null")
    pad = PadConfig(name="skin", source=source, geometry=GeometryConfig(board=configured))  # type: ignore[arg-type]
    return judged_pad(pad, readings, pole)


def _pairs() -> list[Any]:
    """Of the true board and the configured one, all; `make test` takes each board as itself and for the one before."""
    marks = {False: (pytest.mark.long,), True: ()}
    return [
        pytest.param(true, configured, marks=marks[(NAMES.index(true) - NAMES.index(configured)) % len(NAMES) < 2])
        for true in NAMES
        for configured in NAMES
    ]


@pytest.mark.parametrize(("true", "configured"), _pairs())
def test_true_board_is_named_for_every_configured_one(true: str, configured: str) -> None:
    readings, someone = readings_of(built_as(true), (21, NAMES.index(true)))
    verdict = verdict_of(configured, readings, someone.pole if true.endswith("_back") else 0)
    said = sentences(verdict)
    if configured == true:
        assert verdict.is_as_drawn, said
        assert said == AS_CONFIGURED
    else:
        assert not verdict.is_as_drawn
        assert said == [f'The configuration names another board. This is board "{true}": set board = "{true}".']


@pytest.mark.parametrize("make", [quarter, mirrored_chip, scaled, mirrored_pad], ids=lambda make: make.__name__)
def test_fault_of_the_right_board_names_no_other_board(make: Any) -> None:
    mistake = make(built_as("anyskin5"), np.random.default_rng(5))
    readings, someone = readings_of(mistake.built, 22)
    verdict = verdict_of("anyskin5", readings, someone.pole)
    said = sentences(verdict)
    assert not verdict.layouts
    assert len(said) == 1
    assert re.search(mistake.words[0], said[0]), said


def test_dead_chip_of_another_board_is_named_with_it() -> None:
    built = built_as("reskin5")
    built.factor[2] = 0.0
    readings, someone = readings_of(built, 23)
    dead, other = sentences(verdict_of("anyskin5", readings, someone.pole))
    assert dead.startswith("Sensor 3 does not measure the magnet")
    assert 'This is board "reskin5"' in other


def test_boards_that_explain_alike_are_all_named() -> None:
    readings, someone = readings_of(built_as("reskin5"), 24)
    verdict = verdict_of("reskin5", readings, someone.pole)
    open_one = replace(verdict, layouts=("reskin5", "anyskin5"))
    assert not open_one.is_decided
    assert sentences(open_one)[0].startswith("2 boards explain the readings: reskin5 and anyskin5.")
    with pytest.raises(NotWritableError, match="did not decide"):
        keys_of(open_one)


def test_named_board_is_written_and_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "pad.toml"
    file.write_text(CONFIG)
    readings, someone = readings_of(built_as("reskin5"), 25)
    verdict = verdict_of("anyskin5", readings, someone.pole)
    pad = load(file)[0].pad[0]
    options = Namespace(write=False, config=file, pad=None)
    offer(verdict, pad, file, options)
    said = capsys.readouterr().err
    assert said.startswith("next: correct the configuration: `fmfts-daemon probe --magnet --write --config")
    assert '    board = "reskin5"\n' in said
    assert file.read_text() == CONFIG
    options.write = True
    offer(verdict, pad, file, options)
    assert load(file)[0].pad[0].geometry.board == "reskin5"
