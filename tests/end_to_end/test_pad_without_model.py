"""A running daemon whose pad fits no contact model: the output of status, listen, both clients, record and replay."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from c_client.built import Talker, build_listener, eventually
from end_to_end.processes import RunningDaemon, run_command

ODD = """
[[pad]]
name = "odd"
[pad.source]
type = "simulated"
[pad.tolerance]
sensor_rotation_deg = 0
cross_axis = 0
[pad.magnet]
rest_mm = [0, 0, 11]
"""
REASON = "no contact model for this pad"
PRESSED_M = 1e-4  # the script's presses move the magnet farther


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDaemon]:
    with RunningDaemon(tmp_path_factory.mktemp("daemon"), ODD) as daemon:
        yield daemon


def test_python_client_gets_invalid_touch_and_displacement(daemon: RunningDaemon) -> None:
    contact = daemon.wait_for(lambda contact: contact.contact is True and (contact.displacement_m or 0.0) > PRESSED_M)
    assert contact.displacement_sd_m is not None
    assert 0.0 < contact.displacement_sd_m < PRESSED_M
    assert (contact.health, contact.force_n, contact.x_m, contact.valid) == ("ok", None, None, False)
    assert contact.reason.startswith(REASON)


def test_c_client_gets_unmeasured_touch_and_displacement(daemon: RunningDaemon, tmp_path: Path) -> None:
    program = build_listener(tmp_path)
    with Talker(program, "odd", daemon.base) as client:
        answer = eventually(
            lambda: client.latest(500),
            lambda answer: answer.get("contact") is True and (answer["displacement_m"] or 0.0) > PRESSED_M,
        )
    assert 0.0 < answer["displacement_sd_m"] < PRESSED_M
    assert (answer["health"], answer["force_n"], answer["measured"], answer["valid"]) == ("ok", None, False, False)
    assert answer["reason"].startswith(REASON)


def _says_why(status: dict[str, list[str]]) -> bool:
    return REASON in " ".join(status["words"])


def test_log_status_listen_and_check_config_say_that_there_is_no_force(daemon: RunningDaemon) -> None:
    told = f"touch, pose and displacement, no place and no force: {REASON}"
    assert f"WARNING pad 'odd': it publishes {told}" in daemon.log.read_text()
    eventually(lambda: {"words": daemon.command("status").stdout.replace("│", " ").split()}, _says_why)
    listened = daemon.command("listen", "--seconds", "2")
    assert listened.returncode == 0, listened.stderr
    assert "mm from rest" in listened.stdout
    assert REASON in listened.stdout
    checked = run_command("check-config", "--config", daemon.config)
    assert checked.returncode == 0
    assert "odd: simulated, 220 Hz, touch, pose and displacement only" in checked.stdout
    assert f"odd: warning: no place and no force: {REASON}" in checked.stderr


def test_recording_of_such_a_pad_replays_bit_for_bit(daemon: RunningDaemon, tmp_path: Path) -> None:
    file = tmp_path / "odd.mcap"
    words = [sys.executable, "-m", "fmfts", "record", file, "--seconds", "3"]
    subprocess.run(words, env=daemon.environment, check=True, capture_output=True, timeout=300)
    replayed = run_command("replay", file, "--json")
    assert replayed.returncode == 0, replayed.stderr
    facts = json.loads(replayed.stdout)
    assert facts["identical"] > 100
    assert facts["different"] == 0
