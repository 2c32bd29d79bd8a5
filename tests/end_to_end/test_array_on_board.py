"""The second standard pad, four magnets over eight sensors, on a board that finds two pads of four there."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest

from end_to_end.processes import FirmwareHost, RunningDaemon
from fmfts.config import PadConfig
from fmfts.config.example import ARRAY_PATH
from fmfts.config.file import load
from fmfts_client import Contact, Status
from fmfts_simulation.finger import Touch
from fmfts_simulation.mounted_magnets import MountedMagnets

pytestmark = pytest.mark.slow

ALL_EIGHT = 0xFF
BESIDE = """
[[pad]]
name = "left"
[pad.source]
type = "bridge"
port = "{port}"
pad_index = 1
range_gauss = 8.1
"""
AMBIENT_T = np.array([2e-5, -1e-5, 4e-5])
TWO = (Touch(-6e-3, 1e-3, 0.9, 0.0, 0.0), Touch(6e-3, -1e-3, 0.9, 0.0, 0.0))


def on_board(port: Path) -> str:
    """The shipped pad's file, with a board instead of the simulation."""
    text = ARRAY_PATH.read_text()
    source = re.sub(r'type = "simulated"\n', f'type = "bridge"\nport = "{port}"\n', text)
    return re.sub(r"fingers = .*\n", "", source) + BESIDE.format(port=port)


def press(board: FirmwareHost, pad: PadConfig, *touches: Touch) -> None:
    inside = MountedMagnets.of(pad, None)
    board.field(inside.field(pad.pad().sensors.position_m, touches, 1.0) + AMBIENT_T)


def of_array(contact: Contact) -> bool:
    return contact.pad == "array"


def test_board_makes_one_pad_of_eight_and_reports_two_fingers(tmp_path: Path) -> None:
    with FirmwareHost(tmp_path, "--array", "--pads", "2") as board:
        pad = load_pad(tmp_path, board)
        press(board, pad)
        with RunningDaemon(tmp_path, on_board(board.port)) as daemon:
            daemon.wait_for(lambda one: of_array(one) and one.sensors_ok == ALL_EIGHT)
            daemon.wait_for(lambda one: one.pad == "left" and one.sensors_ok == 0b1111)
            recorded = daemon.command(
                "baseline", "--pad", "array", "--rest", "--duration-s", "2", "--config", daemon.config
            )
            assert recorded.returncode == 0, recorded.stderr
            quiet = daemon.wait_for(lambda one: of_array(one) and one.health == "ok")
            assert quiet.contact is False
            press(board, pad, *TWO)
            both = daemon.wait_for(lambda one: of_array(one) and one.contacts is not None and len(one.contacts) == 2)
            later = daemon.wait_for(lambda one: of_array(one) and one.seq >= both.seq + 200)
            assert later.health == "ok"
            assert later.contacts is not None
            found = sorted(later.contacts, key=lambda finger: finger.x_m)
            for finger, touch in zip(found, TWO, strict=True):
                assert abs(finger.x_m - touch.x_m) < 5.0 * finger.x_sd_m
                assert abs(finger.y_m - touch.y_m) < 5.0 * finger.y_sd_m
                assert abs(finger.force_n - touch.force_n) < 5.0 * finger.force_sd_n
            check_resets(board, daemon)
            check_a_missing_sensor_is_named(board, daemon)


def load_pad(folder: Path, board: FirmwareHost) -> PadConfig:
    file = folder / "array.toml"
    file.write_text(on_board(board.port))
    return load(file)[0].pad[0]


def check_resets(board: FirmwareHost, daemon: RunningDaemon) -> None:
    """Two fingers press all the time: only this pad's values are published as ok, and the pad recovers by itself."""
    force_n = sum(touch.force_n for touch in TWO)
    for command in ("reset", "reset-pin"):
        with daemon.subscribe() as messages:
            board.tell(command)
            until, good, told_s = time.monotonic() + 20.0, 0, time.monotonic()
            while good < 100 and time.monotonic() < until:
                message = messages.receive(1.0)
                if message is None:
                    continue
                contact = Contact.from_message(message.body)
                if of_array(contact) and contact.health in ("ok", "degraded"):
                    # A frame just after a reset may lack sensors that are not set up yet, and reports that.
                    assert contact.force_n is not None
                    assert abs(contact.force_n - force_n) < 5.0 * contact.force_sd_n, f"{command}: {contact}"
                    good += contact.sensors_ok == ALL_EIGHT and time.monotonic() > told_s + 0.5
            assert good == 100, (command, daemon.log.read_text())


def check_a_missing_sensor_is_named(board: FirmwareHost, daemon: RunningDaemon) -> None:
    board.tell("fault 0 6 unplugged")
    daemon.wait_for(lambda one: of_array(one) and one.sensors_ok == ALL_EIGHT & ~(1 << 6))
    with daemon.subscribe("status") as messages:
        told: list[str] = []
        until = time.monotonic() + 20.0
        while not told and time.monotonic() < until:
            message = messages.receive(5.0)
            assert message is not None
            status = Status.from_message(message.body)
            told = [fault for fault in status.sensor_faults if "sensor 7" in fault]
    assert told == ["sensor 7 (mux 0x70, channel 6) does not answer at 0x1E: check SDA/SCL of that channel"]
