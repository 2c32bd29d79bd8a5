"""A pad of silicone stiffer than the model's, from README's commands to a weight: the firmware's host build."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from end_to_end.processes import FirmwareHost, RunningDaemon
from end_to_end.test_learn import said, settled
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array
from fmfts_lab.bench.recorded import pressed_field
from fmfts_simulation.mounted import MountedPad

STIFFNESS, WEIGHT_N, FORCE_N, PRESSED_N = 1.4, 0.980665, 1.2, 0.45
EARTH_T = np.array([2e-5, 0.0, 4e-5])
README = Path(__file__).parents[2] / "README.md"


def built() -> MountedPad:
    exact = MountedPad.exact(PadConfig(name="standard", source=SimulatedSource()).pad())
    return replace(exact, ambient_t=EARTH_T)


def pressed(x_m: float, y_m: float, force_n: float) -> Array:
    """Silicone that is stiffer by a factor moves like the model's under a force smaller by that factor."""
    return pressed_field(built(), x_m, y_m, force_n / STIFFNESS)


def typed_by_readme() -> list[list[str]]:
    """The commands of "Use your own pad", as it has them."""
    section = README.read_text(encoding="utf-8").partition("## Use your own pad")[2].partition("\n## ")[0]
    lines = [line.partition("#")[0] for line in section.splitlines() if line.startswith("    fmfts-daemon ")]
    return [shlex.split(line)[1:] for line in lines]


def test_stranger_weighs_a_pad_and_its_forces_are_right(tmp_path: Path) -> None:
    """README's commands in its order. Only `init` is told a port: no list of devices has a pty. This robot does not
    turn, and nothing is refined."""
    init, probe, selftest, bare, rest, turn, refine, weigh, run, _ = typed_by_readme()
    assert (turn, refine, run) == (["baseline", "--turn"], ["baseline", "--refine"], ["run"])
    assert weigh[:2] == ["weigh", "100g"]
    with FirmwareHost(tmp_path) as board:
        said(tmp_path, *init, "--port", board.port)
        early = said(tmp_path, "weigh", "100g", code=65)
        assert "rest is not recorded: `fmfts-daemon baseline --rest` while nothing touches the pad, then weigh" in early
        board.field(built().sensed(np.tile(EARTH_T, (4, 1))))
        assert "fmfts-daemon selftest" in said(tmp_path, *probe)
        assert "fmfts-daemon baseline --bare" in said(tmp_path, *selftest)
        assert "fmfts-daemon baseline --rest" in said(tmp_path, *bare)
        board.field(pressed(0.0, 0.0, 0.0))
        said(tmp_path, *rest)
        assert "no weight is detected: put it on the middle" in said(tmp_path, "weigh", "100g", code=65)
        assert "100 has no unit: write 100g for grams, 100N for newtons" in said(tmp_path, "weigh", "100", code=2)

        board.field(pressed(0.0, 0.0, WEIGHT_N))
        facts = json.loads(said(tmp_path, "weigh", "100g", "--by", "6mm", "--json"))
        assert facts["weight_n"] == pytest.approx(WEIGHT_N)
        assert facts["stiffness"] == pytest.approx(STIFFNESS, abs=2.0 * facts["stiffness_sd"])

        with RunningDaemon(tmp_path, (tmp_path / "pad.toml").read_text()) as daemon:
            told = daemon.command("status").stdout
            assert "times as stiff as the model's, as a weight showed" in " ".join(told.replace("│", " ").split())
            contradicts = daemon.command("weigh", "0.2kg", "--by", "6mm", "--pad", "left")
            assert contradicts.returncode == 65
            assert "compare weight and unit; if the earlier one was wrong: --anew" in contradicts.stderr
            again = daemon.command("weigh", "0.981N", "--by", "6mm", "--pad", "left")
            assert again.returncode == 0, again
            assert "it should now show the weight; the running daemon uses the result already" in again.stdout
            board.field(pressed(0.0, 0.0, 0.0))
            daemon.wait_for(lambda contact: contact.contact is False)
            board.field(pressed(3e-3, -2e-3, FORCE_N))
            contact = settled(daemon)
            assert contact.force_n == pytest.approx(FORCE_N, rel=0.05)
            assert contact.force_sd_n is not None
            assert contact.force_sd_n < 0.15 * FORCE_N
            board.field(pressed(0.0, 0.0, 0.0))
            daemon.wait_for(lambda contact: contact.contact is False)
            replaced = daemon.command("baseline", "--rest", "--replaced", "--pad", "left")
            assert "the new silicone is assumed to be as stiff as the old one, which was weighed" in replaced.stdout
            assert "press on this pad" not in replaced.stdout
            board.field(pressed(0.0, 0.0, PRESSED_N))
            replaced = daemon.command("baseline", "--rest", "--replaced", "--pad", "left")
            assert "N press on this pad: if it is the same pad and something lies on it" in replaced.stdout
            board.field(pressed(0.0, 0.0, 0.0))
            assert daemon.command("baseline", "--rest", "--replaced", "--pad", "left").returncode == 0
        board.field(pressed(0.0, 0.0, PRESSED_N))
        assert "N press on this pad" in said(tmp_path, "baseline", "--rest", "--replaced")
