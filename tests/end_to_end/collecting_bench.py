"""A bench to collect on: an emulated machine moves a rod, the pad gives way, the gauge feels it, the board sees it.

Every device speaks its own protocol on its own pty, the board is the firmware's host build; nothing is shared with the
daemon but the pad's mechanics. `speed`: how much faster than its feeds the machine moves; board and gauge run in real
time.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Self

import numpy as np

from emulator.force_gauge import SerialForceGauge
from emulator.gcode_machine import GcodeMachine
from emulator.priority import put_ahead
from end_to_end.processes import FirmwareHost
from fmfts.config import PadConfig, SimulatedSource
from fmfts.simulate.cylinder import cylinder_field
from fmfts.simulate.mounted import MountedPad

ORIGIN_MM, SURFACE_MM, CLEAR_MM = (100.0, 100.0), 10.0, 12.0
HALF_SPAN_MM = 17.0
CENTRE_MM_PER_N, EDGE_MM_PER_N = (
    1.0,
    0.15,
)  # how far the rod sinks in: the slab bends in the middle, and is soft anywhere
UPDATE_S = 0.004
EARTH_T = np.array([2.1e-5, -0.4e-5, 4.3e-5])
GAUGE_RATE_HZ = 160.0

CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "bridge"
port = "{folder}/board"
[collect]
settle_s = 0.1
silence_ms = {silence_ms}
[collect.gauge]
{gauge}
[collect.stage]
port = "{folder}/machine"
dialect = "{dialect}"
travel_mm = [[80, 120], [80, 120], [5, 40]]
force_limit_n = {limit_n}
origin_mm = [100, 100]
clear_z_mm = {clear_mm}
step_mm = 0.1
"""


SERIAL_GAUGE = """type = "serial"
port = "{folder}/gauge"
pattern = '([-+]\\d+\\.\\d+) N'
delay_ms = {delay_ms}"""
NEWTON_PER_COUNT, COUNTS_AT_ZERO = -2.1e-6, 81234  # a cell that counts down, and no cell is at zero
LOAD_CELL = f'type = "hx711"\nnewton_per_count = {NEWTON_PER_COUNT}'


class PressedBench:
    """The pad under the rod. `pad` may be moved: what the board sees changes then, as after a knock."""

    def __init__(
        self,
        folder: Path,
        dialect: str = "marlin",
        *,
        backlash_mm: float = 0.05,
        noise_n: float = 0.005,
        delay_s: float = 0.02,
        dropout: float = 0.02,
        speed: float = 10.0,
        limit_n: float = 4.5,
        silence_ms: float = 1000.0,  # nothing else may run on a machine that is to hold 100
        chip_noise_ut: float = 0.2,
        load_cell: bool = False,
    ) -> None:
        self.folder = folder
        self.knock_m = np.zeros(3)
        self.stiffening = 1.0  # the pad resists so many times as much as it should
        self.mounted = True  # else there is no magnet: for a bare baseline
        self.beside = False  # the rod presses on something that is not the pad
        self.force_n = 0.0
        self.truth: list[tuple[int, float, float, float]] = []  # monotonic ns, x and y in mm, force, at each change
        self._pad = MountedPad.exact(PadConfig(name="left", source=SimulatedSource()).pad())
        self._told: tuple[float, ...] | None = None
        self._chip_noise_ut = chip_noise_ut
        self.board = FirmwareHost(folder)
        put_ahead(self.board.pid)
        self.machine = GcodeMachine(folder / "machine", dialect, backlash_mm=backlash_mm, speed=speed)
        self.machine.on_moved = self._moved
        self.gauge = SerialForceGauge(
            folder / "gauge",
            lambda: self.force_n,
            rate_hz=GAUGE_RATE_HZ,
            noise_n=noise_n,
            delay_s=delay_s,
            dropout=dropout,
        )
        self.config = folder / "config.toml"
        gauge = LOAD_CELL if load_cell else SERIAL_GAUGE.format(folder=folder, delay_ms=delay_s * 1e3)
        facts = {"folder": folder, "dialect": dialect, "gauge": gauge, "limit_n": limit_n, "silence_ms": silence_ms}
        self.config.write_text(CONFIG.format(clear_mm=CLEAR_MM, **facts))
        self.environment = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}
        self._rod_mm = list(self.machine.place)
        self._load_cell = load_cell
        self._telling = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)

    def __enter__(self) -> Self:
        self.board.tell(f"noise 0 {self._chip_noise_ut}")
        self._tell_field()
        self._thread.start()
        self.machine.__enter__()
        self.gauge.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.gauge.__exit__()
        self.machine.__exit__()
        self.board.__exit__()

    def tell(self, command: str) -> None:
        """The board, between two fields."""
        with self._telling:
            self.board.tell(command)

    def rod_is_up(self) -> bool:
        return self._rod_mm[2] >= SURFACE_MM

    def _moved(self, place: list[float]) -> None:
        self._rod_mm = place
        x_mm, y_mm = place[0] - ORIGIN_MM[0], place[1] - ORIGIN_MM[1]
        self.force_n = max(0.0, SURFACE_MM - place[2]) / mm_per_n(x_mm, y_mm) * self.stiffening
        now = (x_mm, y_mm, self.force_n)
        if not self.truth or self.truth[-1][1:] != now:
            self.truth.append((time.monotonic_ns(), *now))

    def _show(self) -> None:
        put_ahead(threading.get_native_id())
        while not self._ended.wait(UPDATE_S):
            self._tell_field()

    def _tell_field(self) -> None:
        x_mm, y_mm = self._rod_mm[0] - ORIGIN_MM[0], self._rod_mm[1] - ORIGIN_MM[1]
        force_n = 0.0 if self.beside else self.force_n
        now = (x_mm, y_mm, force_n, *self.knock_m, self.mounted)
        if now == self._told:
            return
        self._told = now
        magnet_t = self.magnet_field_t(x_mm * 1e-3, y_mm * 1e-3, force_n) if self.mounted else np.zeros((4, 3))
        field_t = self._pad.sensed(magnet_t + EARTH_T)
        with self._telling:
            self.board.field(field_t)
            if self._load_cell:
                self.board.tell(f"load {round(self.force_n / NEWTON_PER_COUNT) + COUNTS_AT_ZERO}")

    def magnet_field_t(self, x_m: float, y_m: float, force_n: float) -> np.ndarray:
        """(4, 3) at the sensors."""
        position_m, axis = self._pad.pose(*(np.full(4, value) for value in (x_m, y_m, force_n)))
        return cylinder_field(self._pad.pad.sensors.position_m, position_m + self.knock_m, axis, self._pad.pad.magnet)

    def start(self, *arguments: str | Path) -> subprocess.Popen[str]:
        """A verb of fmfts-daemon, under way."""
        words: list[str | Path] = [sys.executable, "-m", "fmfts", *arguments, "--config", self.config]
        pipe = subprocess.PIPE
        process = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=self.environment)
        if "collect" in arguments:
            put_ahead(process.pid)
        return process

    def collect(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        """`collect` to its end. Where a busy computer made a device late, it stopped as it should, and goes on."""
        for _ in range(5):
            done = self.command("collect", *arguments)
            if not was_late(done.stderr):
                break
        return done

    def command(self, *arguments: str | Path, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
        """A verb of fmfts-daemon, to its end."""
        with self.start(*arguments) as process:
            try:
                out, errors = process.communicate(timeout=timeout_s)
            except BaseException:
                process.kill()
                raise
        return subprocess.CompletedProcess(process.args, process.returncode, out, errors)


def was_late(errors: str) -> bool:
    """Not what a test did: nobody ran the emulated devices for a while, or whoever should have heard them."""
    signs = ("frames were lost", "no frame for", "the gauge is silent", "frames arrived of", "did not end")
    return any(sign in errors for sign in signs)


def mm_per_n(x_mm: float, y_mm: float) -> float:
    """How far the rod sinks in at a place."""
    bend = max(0.0, 1.0 - (x_mm / HALF_SPAN_MM) ** 2) * max(0.0, 1.0 - (y_mm / HALF_SPAN_MM) ** 2)
    return EDGE_MM_PER_N + (CENTRE_MM_PER_N - EDGE_MM_PER_N) * bend**2
