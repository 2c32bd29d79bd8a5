"""`probe --magnet` as a person types it, with the firmware's host build as the board.

The magnet's field is that of a dipole, J. D. Jackson, Classical Electrodynamics, 3rd edition, equation 5.56.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, Queue

import numpy as np
import pytest

from emulator.anyskin_board import binary
from emulator.anyskin_on_pty import Board
from end_to_end.processes import FirmwareHost, RunningDaemon
from fmfts.common import exit_codes
from fmfts.config.file import load
from unit.published_boards import chips

UID = "0123456789abcdef01234567"
CONFIG = """# my pad
[[pad]]
name = "left"
[pad.source]
type = "bridge"
port = "{port}"     # by its link
[pad.geometry]
sensors_mm = [[8, 8, 0], [8, -8, 0],
              [-8, 8, 0], [-8, -8, 0]]   # from the drawing
[pad.magnet]
remanence_t = 1.23  # N35
"""
SKIN_CONFIG = """[[pad]]
name = "skin"
[pad.source]
type = "anyskin"
port = "{port}"
form = "binary"
rate_hz = 100
[pad.geometry]
board = "anyskin5"
[pad.contact]
model = "none"
"""
PLACES_M = np.array([[8, 8, 0], [8, -8, 0], [-8, 8, 0], [-8, -8, 0]]) * 1e-3
EARTH_T = np.array([1.5e-5, -0.5e-5, -4.2e-5])
OWN_T = 8e-5 * np.array([[-0.6, -0.6, 0.4], [-0.6, 0.6, 0.4], [0.6, -0.6, 0.4], [0.6, 0.6, 0.4]])  # a mounted pad's
MOMENT_A_M2 = 0.02  # a neodymium cylinder of 3 mm
HANDS_MM = ((1.0, -2.0, 34.0), (21.0, 1.5, 33.0), (-1.0, 18.0, 36.0))
TILTS = ((0.1, 0.05), (-0.15, 0.1), (0.05, -0.2))
PATIENCE_S = 60.0
NO_SWAP, SWAP = [0, 1, 2, 3], [2, 1, 0, 3]


def dipole_field(moment: np.ndarray, place_m: np.ndarray, sensors_m: np.ndarray = PLACES_M) -> np.ndarray:
    """Jackson 5.56, outside the magnet, at all sensors."""
    r = sensors_m - place_m
    distance = np.linalg.norm(r, axis=1, keepdims=True)
    n = r / distance
    return 1e-7 * (3.0 * n * (n @ moment)[:, None] - moment) / distance**3


class Check:
    """The process, and the person at the board."""

    def __init__(self, board: FirmwareHost, order: list[int], *words: str | Path, environment: dict[str, str]) -> None:
        self._board, self._order = board, order
        self.process = subprocess.Popen(
            [sys.executable, "-m", "fmfts", "probe", "--magnet", *words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
        self.said: list[str] = []
        self._lines: Queue[str] = Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr
        for line in self.process.stderr:
            self._lines.put(line)

    def wait_for(self, text: str) -> None:
        while not (self.said and text in self.said[-1]):
            try:
                self.said.append(self._lines.get(timeout=PATIENCE_S))
            except Empty:
                raise AssertionError(f"no {text!r} in {self.said}") from None

    def magnet(self, step: int | None, strength: float = 1.0) -> None:
        field = np.tile(EARTH_T, (4, 1)) + OWN_T
        if step is not None:
            x, y = TILTS[step]
            moment = strength * MOMENT_A_M2 * np.array([x, y, -np.sqrt(1.0 - x * x - y * y)])
            field = field + dipole_field(moment, np.array(HANDS_MM[step]) * 1e-3)
        self._board.field(field[self._order])

    def enter(self) -> None:
        assert self.process.stdin
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def ended(self) -> tuple[int, str]:
        """The exit code, and the output."""
        assert self.process.stdout
        assert self.process.stdin
        assert self.process.stderr
        output = self.process.stdout.read()
        code = self.process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            pipe.close()
        while not self._lines.empty():
            self.said.append(self._lines.get())
        return code, output


class SkinCheck(Check):
    """The same person at a published board: its chips are as in published_boards.py, not in config/layouts.py."""

    def __init__(self, board: Board, name: str, *words: str | Path, environment: dict[str, str]) -> None:
        self._skin, self._chips = board, chips(name)
        super().__init__(None, [], *words, environment=environment)  # type: ignore[arg-type]

    def magnet(self, step: int | None, strength: float = 1.0) -> None:
        places_mm, axes = self._chips
        field = np.tile(EARTH_T, (5, 1))
        if step is not None:
            x, y = TILTS[step]
            moment = strength * MOMENT_A_M2 * np.array([x, y, -np.sqrt(1.0 - x * x - y * y)])
            field = field + dipole_field(moment, np.array(HANDS_MM[step]) * 1e-3, places_mm * 1e-3)
        self._skin.field_t = np.einsum("nij,ni->nj", axes, field)


def followed(check: Check) -> tuple[int, str]:
    """A person who follows the check's instructions."""
    check.magnet(None)
    check.wait_for("Step 0")
    check.wait_for("steady")
    check.enter()
    for step in range(3):
        check.wait_for(f"Step {step + 1}")
        check.magnet(step)
    return check.ended()


@contextmanager
def board_and_config(folder: Path) -> Iterator[tuple[FirmwareHost, Path, dict[str, str]]]:
    with FirmwareHost(folder, "--uid", UID, "--pads", "1") as board:
        config = folder / "pad.toml"
        config.write_text(CONFIG.format(port=board.port))
        environment = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}
        yield board, config, environment


def test_good_pad_is_as_drawn_in_words_and_picture(tmp_path: Path) -> None:
    with board_and_config(tmp_path) as (board, config, environment):
        code, output = followed(Check(board, NO_SWAP, "--config", config, environment=environment))
    assert code == exit_codes.DONE, output
    assert "Places, axes, signs and scales are as the configuration says." in output
    assert all(f"{sensor} ✓" in output for sensor in range(1, 5))
    assert "✗" not in output


def test_swapped_channels_are_named_written_and_then_good(tmp_path: Path) -> None:
    with board_and_config(tmp_path) as (board, config, environment):
        first = Check(board, SWAP, "--config", config, "--write", environment=environment)
        code, output = followed(first)
        assert code == exit_codes.FAULTY, first.said
        assert "Sensors 1 and 3 are swapped" in output
        assert any("is written anew" in line for line in first.said), "".join(first.said) + output
        text = config.read_text()
        assert "# by its link" in text
        assert "# N35" in text
        assert "# from the drawing" in text
        assert (tmp_path / "pad.toml.bak").read_text() == CONFIG.format(port=board.port)
        assert load(config)[0].pad[0].geometry.sensors_mm == ((-8, 8, 0), (8, -8, 0), (8, 8, 0), (-8, -8, 0))
        second = Check(board, SWAP, "--config", config, environment=environment)
        code, output = followed(second)
    assert code == exit_codes.DONE, (output, second.said)


def test_wrong_board_name_is_corrected_and_then_good(tmp_path: Path) -> None:
    with Board(tmp_path, 100.0, binary) as board:
        config = tmp_path / "pad.toml"
        config.write_text(SKIN_CONFIG.format(port=board.link))
        environment = os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}", "XDG_STATE_HOME": str(tmp_path / "state")}
        first = SkinCheck(board, "reskin5", "--config", config, "--write", environment=environment)
        code, output = followed(first)
        assert code == exit_codes.FAULTY, (output, first.said)
        assert 'This is board "reskin5": set board = "reskin5".' in output
        assert load(config)[0].pad[0].geometry.board == "reskin5"
        second = SkinCheck(board, "reskin5", "--config", config, environment=environment)
        code, output = followed(second)
    assert code == exit_codes.DONE, (output, second.said)


def test_check_uses_a_running_daemon_and_repeats_a_weak_step(tmp_path: Path) -> None:
    with (
        FirmwareHost(tmp_path, "--uid", UID, "--pads", "1") as board,
        RunningDaemon(tmp_path, CONFIG.format(port=board.port)) as daemon,
    ):
        check = Check(board, SWAP, "--config", daemon.config, environment=daemon.environment)
        check.magnet(None)
        check.wait_for("steady")
        check.enter()
        check.wait_for("Step 1")
        check.magnet(0, strength=0.05)
        check.wait_for("too weak")
        check.magnet(0, strength=30.0)
        check.wait_for("too strong")
        check.magnet(0)
        check.wait_for("Step 2")
        check.enter()  # without a movement
        check.wait_for("move the magnet to the new place")
        check.magnet(1)
        check.wait_for("Step 3")
        check.magnet(2)
        code, output = check.ended()
    assert code == exit_codes.FAULTY, (output, check.said)
    assert "Sensors 1 and 3 are swapped" in output
    assert any("sensors_mm = [[-8, 8, 0], [8, -8, 0], [8, 8, 0], [-8, -8, 0]]" in line for line in check.said), (
        check.said
    )


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (("--pole", "up"), exit_codes.USAGE, "--pole and --write belong to --magnet"),
        (("--magnet", "--pad", "right"), exit_codes.USAGE, "'right'"),
    ],
)
def test_wrong_message_words_are_refused(words: tuple[str, ...], code: int, text: str, tmp_path: Path) -> None:
    config = tmp_path / "pad.toml"
    config.write_text(CONFIG.format(port=tmp_path / "nothing"))
    ended = subprocess.run(
        [sys.executable, "-m", "fmfts", "probe", *words, "--config", config],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == code, ended
    assert text in ended.stderr
