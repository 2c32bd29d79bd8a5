"""A skin of unknown magnets on a board with AnySkin firmware: from labelled presses to contacts, by the real verbs."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from emulator.anyskin_board import binary
from emulator.anyskin_on_pty import Board
from end_to_end.processes import RunningDaemon, run_command
from fmfts_client import Contact
from skin.skin_pad import SENSORS_MM, presses, skin_set, streamed_field, write_skin

# Their stream has no numbers, so a late computer measures a wrong rate.
pytestmark = pytest.mark.real_time

CONFIG = """
[[pad]]
name = "skin"
[pad.source]
type = "anyskin"
port = "{port}"
rate_hz = 50
[pad.geometry]
sensors_mm = {sensors_mm}
[pad.contact]
model = "{model}"
"""
MM_OF_A_NEWTON = 0.3
PRESS = (3.0, -2.0, 5.0)


def field_t(x_mm: float, y_mm: float, force_n: float) -> np.ndarray:
    return streamed_field(np.array([[x_mm, y_mm, force_n * MM_OF_A_NEWTON]])).reshape(5, 3) * 1e-6


def calibrated(folder: Path) -> Path:
    """A table from 600 labelled presses, by the verb."""
    press = presses(600, 1)
    noisy = streamed_field(press) + np.random.default_rng(2).normal(0.0, 1.5, (len(press), 15))
    press[:, 2] /= MM_OF_A_NEWTON
    data = write_skin(folder / "presses.csv", skin_set(press, noisy, ("x_mm", "y_mm", "force_n")))
    made = run_command("calibrate", data, "-o", folder / "skin.response")
    assert made.returncode == 0, made.stderr
    return folder / "skin.response"


def test_press_on_a_skin_is_published_and_replayed_identically(tmp_path: Path) -> None:
    model = calibrated(tmp_path)
    with Board(tmp_path, 50.0, binary) as board:
        board.field_t = field_t(0.0, 0.0, 0.0)
        config = CONFIG.format(port=board.link, sensors_mm=SENSORS_MM.tolist(), model=model)
        with RunningDaemon(tmp_path, config) as daemon:
            assert "unknown magnets, place and force" in daemon.log.read_text()
            daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b11111)
            said = daemon.command("baseline", "--rest", "--config", daemon.config)
            assert said.returncode == 0, said
            quiet = daemon.wait_for(lambda contact: contact.health == "ok")
            assert quiet.contact is False
            board.field_t = field_t(*PRESS)
            settled_ns = time.monotonic_ns() + 300_000_000

            def is_settled(contact: Contact) -> bool:
                return contact.t_sample_ns > settled_ns and contact.health == "ok"

            felt = daemon.wait_for(is_settled)
            assert felt.contact
            assert felt.x_m is not None
            assert felt.force_n is not None
            assert abs(felt.x_m * 1e3 - PRESS[0]) < 5e3 * (felt.x_sd_m or 0.0)
            assert abs(felt.force_n - PRESS[2]) < 5 * (felt.force_sd_n or 0.0)
            assert (felt.x_sd_m or 1.0) < 1e-3
            file = tmp_path / "skin.mcap"
            words = [sys.executable, "-m", "fmfts", "record", file, "--pad", "skin", "--seconds", "3"]
            subprocess.run(words, env=daemon.environment, check=True, capture_output=True, timeout=300)
            listened = daemon.command("listen", "--pad", "skin", "--seconds", "1")
            assert listened.returncode == 0, listened.stderr
    replayed = run_command("replay", file, "--model", model, "--json")
    assert replayed.returncode == 0, replayed.stderr
    facts = json.loads(replayed.stdout)
    assert facts["identical"] > 50
    assert facts["different"] == 0
