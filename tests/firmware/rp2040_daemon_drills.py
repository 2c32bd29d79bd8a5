"""The daemon's own verbs on an emulated Pico, over a pty that stands for its USB (`make test-rp2040`).

The emulator is several times slower than the chip. So the daemon's clock is slowed, too (`faketime`): to it, the board
runs at its full rate.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from test_stm32_build import FIRMWARE, make

from emulator.pace import slowed

ROOT = FIRMWARE.parent
LIBRARY = Path(os.environ.get("RP2040JS") or ROOT / ".venv/node_modules/rp2040js")
RUNNER = ROOT / "tests/emulator/rp2040_on_pty.py"
PACE = 0.02  # share of real time: alone on a computer the emulator reaches 0.2, beside others a tenth of that
PATIENCE_S = 600.0  # beside programs of a higher priority the emulator may get a twentieth of a processor
LOOK_S = 5.0  # asking costs the emulator a second
pytestmark = pytest.mark.needs("arm-none-eabi-gcc", "node", "faketime")


@contextmanager
def plugged_in(port: Path, *options: str) -> Iterator[None]:
    """A Pico that was just flashed; `port` is its link to the pty."""
    make("rp2040")
    command = [
        sys.executable,
        RUNNER,
        LIBRARY,
        FIRMWARE / "build/fmfts-rp2040.bin",
        "--link",
        port,
        "--pace",
        str(PACE),
    ]
    with subprocess.Popen([*command, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as pico:
        try:
            assert pico.stdout is not None
            assert pico.stdout.readline().startswith("pty: ")
            yield
        finally:
            pico.terminate()


class Slowed:
    """The daemon's verbs at the board's pace, with sockets and state in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._surroundings = (
            os.environ | slowed(PACE) | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": f"{folder}/state"}
        )

    def begun(self, *verb: str | Path) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "fmfts", *verb],
            cwd=self._folder,
            env=self._surroundings,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def ended(self, *verb: str | Path) -> tuple[int, str]:
        """The exit code and the output."""
        with self.begun(*verb) as process:
            try:
                said, _ = process.communicate(timeout=PATIENCE_S)
            except BaseException:
                process.kill()
                raise
        return process.returncode, said

    def said(self, *verb: str | Path) -> str:
        code, said = self.ended(*verb)
        assert code == 0, said
        return said


@pytest.mark.parametrize(
    ("options", "chip", "way"),
    [
        (["--chips", "mmc5983ma"], "mmc5983ma", "mux address: 0x70"),
        (["--chips", "mlx90393", "--addresses", "0x0c,0x0d,0x0e,0x0f"], "mlx90393", "0x0f"),
    ],
)
def test_init_probe_and_run_on_a_pico(tmp_path: Path, options: list[str], chip: str, way: str) -> None:
    daemon = Slowed(tmp_path)
    with plugged_in(tmp_path / "pico", *options):
        assert "written for board e6613852830a5c2100000000" in daemon.said("init", "--port", tmp_path / "pico")
        assert f'chip = "{chip}"' in (tmp_path / "pad.toml").read_text()
        assert daemon.said("check-config").startswith("good: 1 pad")
        probed = daemon.said("probe")
        assert "sound: yes" in probed
        assert way in probed
        with daemon.begun("run") as running:
            try:
                until_s = time.monotonic() + PATIENCE_S
                while "no_baseline" not in (status := daemon.ended("status")[1]):  # the first comes after a second
                    assert running.poll() is None
                    assert time.monotonic() < until_s, status
                    time.sleep(LOOK_S)
            finally:
                running.terminate()
