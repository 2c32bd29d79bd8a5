"""`collect --by-hand`, the real process by the real clock: a scripted person follows its instructions, and a UDP gauge
measures."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from emulator.force_gauge import UdpForceGauge
from end_to_end.firmware_in_the_loop import PressedPad
from end_to_end.processes import BRIDGE_CONFIG, FirmwareHost, RunningDaemon
from end_to_end.test_collect import frames_behind, plan, rows
from fmfts.config.file import load
from fmfts_simulation.mounted import MountedPad
from ports import free_udp_port

HAND_CONFIG = """
[collect]
settle_s = 0.1
[collect.gauge]
type = "udp"
port = {gauge}
pattern = '([-+]\\d+\\.\\d+) N'
"""
pytestmark = pytest.mark.real_time  # a person presses steadily, or sways, with time
PATIENCE_S = 120.0
WANTED = re.compile(r"press (?P<force>[\d.]+) N at x (?P<x>\S+), y (?P<y>\S+) mm")


class Person:
    """Follows a process's instructions. how: for each press in turn, "steady", "sways", or "beside" the pad."""

    def __init__(self, board: FirmwareHost, config: Path, gauge_port: int, how: list[str]) -> None:
        self.heard: list[str] = []
        self._pad = PressedPad(board, load(config)[0].pad[0].pad())
        self._gauge = UdpForceGauge(gauge_port, lambda: self._force_n, rate_hz=160.0, noise_n=0.005)
        self._how = how
        self._place_m = (0.0, 0.0)
        self._target_n = self._force_n = 0.0
        self._deed = "steady"
        self._told_to_hold = False
        self._ended = threading.Event()
        self._acting = threading.Thread(target=self._act, daemon=True)

    def obey(self, process: subprocess.Popen[str]) -> None:
        """Press as asked until the process ends."""
        assert process.stderr is not None
        for line in process.stderr:
            self.heard.append(line.strip())
            wanted = WANTED.search(line)
            if wanted:
                self._deed = self._how.pop(0) if self._how else "steady"
                self._place_m = (float(wanted["x"]) * 1e-3, float(wanted["y"]) * 1e-3)
                self._told_to_hold = False
                self._target_n = float(wanted["force"])
            elif line.startswith("hold"):
                self._told_to_hold = True
            elif "hands off" in line or line.startswith("let go"):
                self._target_n = 0.0

    def _act(self) -> None:
        before_s = time.monotonic()
        touched = (0.0, 0.0, 0.0)
        while not self._ended.wait(0.004):
            now_s = time.monotonic()
            sways = self._deed == "sways" and self._told_to_hold
            self._force_n = self._target_n * (1.0 + 0.5 * sways * np.sin(2.0 * np.pi * 4.0 * now_s))
            touch = (*self._place_m, self._force_n * (self._deed != "beside"))
            if touch != touched:
                self._pad.touch(*touch)
                touched = touch
            self._gauge.turn(now_s - before_s)
            before_s = now_s

    def __enter__(self) -> Person:
        self._acting.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._acting.join()
        self._gauge.__exit__()


@pytest.fixture
def board(tmp_path: Path) -> Iterator[FirmwareHost]:
    with FirmwareHost(tmp_path) as board:
        board.tell("noise 0 0.2")
        yield board


def pressed_by_hand(
    board: FirmwareHost, daemon: RunningDaemon, gauge_port: int, how: list[str]
) -> tuple[int, dict[str, object], list[str]]:
    """Exit code, facts, and output while two places were pressed."""
    words = ["collect", plan(daemon.folder), "-o", daemon.folder / "data.csv", "--by-hand", "--json"]
    with Person(board, daemon.config, gauge_port, how) as person:
        assert daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config).returncode == 0
        with subprocess.Popen(
            [sys.executable, "-m", "fmfts", *words, "--config", daemon.config],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=daemon.environment,
        ) as process:
            patience = threading.Timer(PATIENCE_S, process.kill)
            patience.start()
            person.obey(process)
            patience.cancel()
            assert process.stdout is not None
            out = process.stdout.read()
    return process.returncode, json.loads(out or "{}"), person.heard


def configuration(board: FirmwareHost, gauge_port: int) -> str:
    return BRIDGE_CONFIG.format(port=board.port) + HAND_CONFIG.format(gauge=gauge_port)


def require_true_rows(folder: Path, config: Path) -> list[dict[str, str]]:
    """The four presses of the plan, with the fields that these presses make."""
    pad = MountedPad.exact(load(config)[0].pad[0].pad())
    collected = rows(folder / "data.csv")
    for row, (x_mm, force_n) in zip(collected, [(-4, 0.6), (-4, 1.2), (2, 0.6), (2, 1.2)], strict=True):
        assert (float(row["x_mm"]), float(row["y_mm"])) == (x_mm, 2.0)
        # a mean of 48 readings of 5 mN, minus the gauge's zero, which is such a mean, too
        assert float(row["force_n"]) == pytest.approx(force_n, abs=0.006)
        field_ut = [float(row[f"b{sensor}{axis}_ut"]) for sensor in range(1, 5) for axis in "xyz"]
        press = (np.full(4, value) for value in (x_mm * 1e-3, 2e-3, force_n))
        # 0.2 µT of noise in 66 frames; a baseline at rest leaves the rest field to 0.1 µT
        np.testing.assert_allclose(field_ut, pad.magnet_field(*press).ravel() * 1e6, atol=0.6)
        assert frames_behind(row, folder) == int(row["frames"])
    return collected


def test_person_is_asked_again_until_each_press_was_good(tmp_path: Path, board: FirmwareHost) -> None:
    """No daemon runs: `collect` opens the board itself."""
    gauge_port = free_udp_port()
    with RunningDaemon(tmp_path, configuration(board, gauge_port)) as daemon:
        assert daemon.stop() == 0
        code, facts, heard = pressed_by_hand(board, daemon, gauge_port, ["sways"] * 4 + ["beside"])
    assert (code, facts.get("collected")) == (0, 4), heard
    again = [line for line in heard if line.startswith("once more (press 1: ")]
    assert len(again) == 5
    assert all("moves" in line or "swings" in line for line in again[:4])
    assert "the pad is not touched" in again[4]
    require_true_rows(tmp_path, daemon.config)


def test_hand_presses_beside_a_running_daemon(tmp_path: Path, board: FirmwareHost) -> None:
    gauge_port = free_udp_port()
    with RunningDaemon(tmp_path, configuration(board, gauge_port)) as daemon:
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
        uid = daemon.request("probe")["pads"][0]["board"]["uid"]
        code, facts, heard = pressed_by_hand(board, daemon, gauge_port, [])
        assert (code, facts.get("collected")) == (0, 4), heard
        assert {row["board"] for row in require_true_rows(tmp_path, daemon.config)} == {uid}
        assert daemon.stop() == 0


def test_pad_that_moved_ends_the_work_of_a_hand(tmp_path: Path, board: FirmwareHost) -> None:
    gauge_port = free_udp_port()
    with RunningDaemon(tmp_path, configuration(board, gauge_port)) as daemon:
        pad = load(daemon.config)[0].pad[0].pad()
        PressedPad(board, pad)
        assert daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config).returncode == 0
        assert daemon.stop() == 0
        knocked = PressedPad(board, pad)
        with UdpForceGauge(gauge_port, lambda: 0.0) as gauge:
            knocked.touch(0.0, 0.0, 0.5)  # as if something had lain on it since then
            ended = threading.Event()
            acting = threading.Thread(target=lambda: [gauge.turn(0.01) for _ in iter(lambda: ended.wait(0.01), True)])
            acting.start()
            done = daemon.command(
                "collect", plan(tmp_path), "-o", tmp_path / "data.csv", "--by-hand", "--config", daemon.config
            )
            ended.set()
            acting.join()
    assert done.returncode == 65
    assert "the pad has moved, or something touches it" in done.stderr
    assert "nothing presses" in done.stderr
