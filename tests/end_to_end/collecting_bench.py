"""A bench to collect on: an emulated machine moves a rod, the pad yields, the gauge measures the force, and the board
the field.

Every device speaks its own protocol on its own pty, the board is the firmware's host build; nothing is shared with the
daemon but the pad's mechanics. All devices share one time. It passes only while the collector, in this process, waits:
then nothing can be late, however busy this computer is, and a quarter of an hour at the bench takes a minute. For the
real process, it runs by the real clock. `speed`: how much faster than its feeds the machine moves.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from emulator.force_gauge import SerialForceGauge
from emulator.gcode_machine import GcodeMachine
from emulator.priority import put_ahead
from end_to_end.processes import FirmwareHost
from fmfts.baseline.files import stored
from fmfts.baseline.job import BaselineJob
from fmfts.baseline.request import BaselineRequest
from fmfts.cli.feed import DeviceFeed, open_feed
from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.file import load_as
from fmfts.pad import Array
from fmfts.sensor.bridge.bridge import Bridge
from fmfts_collect import guard
from fmfts_collect.clock import Clock, Monotonic
from fmfts_collect.settings import CollectingConfig
from fmfts_collect.work import collect
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.mounted import MountedPad

ORIGIN_MM, SURFACE_MM, CLEAR_MM = (100.0, 100.0), 10.0, 12.0
HALF_SPAN_MM = 17.0
CENTRE_MM_PER_N, EDGE_MM_PER_N = 1.0, 0.15  # the rod sinks in: the slab bends in the middle, and is soft anywhere
UPDATE_S = 0.004
TICK_S = 0.001
EARTH_T = np.array([2.1e-5, -0.4e-5, 4.3e-5])
GAUGE_RATE_HZ = 160.0
# The guard is a process of its own and waits by the real clock, in which this process may stand still for seconds.
STEPPED_HANG_S = 120.0

CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "bridge"
port = "{folder}/board"
[collect]
settle_s = 0.1
average_s = {average_s}
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
lift_mm_per_s = {lift_mm_per_s}
step_mm = 0.1
overshoot_mm = {overshoot_mm}
"""


SERIAL_GAUGE = """type = "serial"
port = "{folder}/gauge"
pattern = '([-+\\w.]+) N'
delay_ms = {delay_ms}"""
NEWTON_PER_COUNT, COUNTS_AT_ZERO = -2.1e-6, 81234  # a cell that counts down, and whose zero is not zero
LOAD_CELL = f'type = "hx711"\nnewton_per_count = {NEWTON_PER_COUNT}'


class SimulatedClock:
    """A Clock on which nothing is late. grain_s: the least time that passes when somebody sleeps."""

    def __init__(self, passed: Callable[[float], None], grain_s: float) -> None:
        self._passed = passed
        self._grain_us = round(grain_s * 1e6)
        self._now_us = 1_000_000_000

    def now_ns(self) -> int:
        return self._now_us * 1000

    def sleep(self, seconds: float) -> None:
        us = max(round(seconds * 1e6), self._grain_us)
        while us > 0:
            step_us = min(us, self._grain_us)
            self._now_us += step_us
            self._passed(step_us * 1e-6)
            us -= step_us


class PressedBench:
    """The pad under the rod. `pad` may be moved, which changes the board's field, as after a knock.

    real_time: by the real clock, in a thread of its own; else time passes in `clock` alone. told_delay_s: the gauge's
    delay in the configuration, None for the true one.
    """

    def __init__(
        self,
        folder: Path,
        dialect: str = "marlin",
        *,
        backlash_mm: float = 0.05,
        noise_n: float = 0.005,
        delay_s: float = 0.02,
        told_delay_s: float | None = None,
        dropout: float = 0.02,
        average_s: float = 0.3,
        overshoot_mm: float = 0.2,
        speed: float = 10.0,
        lift_mm_per_s: float = 4.0,
        z_limit_mm_per_s: float = 5.0,
        limit_n: float = 4.5,
        silence_ms: float = 100.0,
        chip_noise_ut: float = 0.2,
        load_cell: bool = False,
        real_time: bool = False,
        grain_s: float = 0.002,
    ) -> None:
        self.folder = folder
        self.knock_m = np.zeros(3)
        self.stiffening = 1.0  # factor by which the pad is too stiff
        self.mounted = True  # false: there is no magnet, for a bare baseline
        self.beside = False  # the rod presses on something other than the pad
        self.force_n = 0.0
        self.truth: list[tuple[int, float, float, float]] = []  # ns, x and y in mm, force, at each change
        self.latest_s = 0.0  # the largest delay of this bench itself
        self.lifted_after_s: float | None = None  # from the fault of `when_pressing` until nothing touches
        self._fault: Callable[[], object] | None = None
        self._fault_ns: int | None = None
        self._without_board = False
        self._pad = exact_pad()
        self._told: tuple[float, ...] | None = None
        self._chip_noise_ut = chip_noise_ut
        self._stepped = not real_time
        self.board = self._made_board()
        self.machine = GcodeMachine(
            folder / "machine", dialect, backlash_mm=backlash_mm, speed=speed, z_limit_mm_per_s=z_limit_mm_per_s
        )
        self.gauge = SerialForceGauge(
            folder / "gauge",
            lambda: self.force_n,
            rate_hz=GAUGE_RATE_HZ,
            noise_n=noise_n,
            delay_s=delay_s,
            dropout=dropout,
        )
        self.machine.port.lockstep = self.gauge.port.lockstep = self._stepped
        self.config = folder / "config.toml"
        told_ms = (delay_s if told_delay_s is None else told_delay_s) * 1e3
        gauge = LOAD_CELL if load_cell else SERIAL_GAUGE.format(folder=folder, delay_ms=told_ms)
        facts = {"folder": folder, "dialect": dialect, "gauge": gauge, "limit_n": limit_n, "silence_ms": silence_ms}
        facts |= {"overshoot_mm": overshoot_mm, "average_s": average_s, "lift_mm_per_s": lift_mm_per_s}
        self.config.write_text(CONFIG.format(clear_mm=CLEAR_MM, **facts))
        self.environment = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}
        self._rod_mm = list(self.machine.place)
        self._load_cell = load_cell
        self._telling = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._keep_time, daemon=True)
        self.clock: Clock = SimulatedClock(self._pass, grain_s) if self._stepped else Monotonic()
        self.machine.on_moved = self._moved

    def _made_board(self) -> FirmwareHost:
        return FirmwareHost(self.folder, *(["--stepped"] if self._stepped else []))

    def __enter__(self) -> PressedBench:
        self.board.tell(f"noise 0 {self._chip_noise_ut}")
        self._tell_field()
        self.machine.__enter__()
        self.gauge.__enter__()
        if not self._stepped:
            put_ahead(self.board.pid)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if not self._stepped:
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

    def unplug_board(self) -> None:
        self._without_board = True
        self.board.kill()

    def when_pressing(self, fault: Callable[[], object]) -> None:
        """An event that happens once, on the way to the second force."""
        self._fault = fault

    @property
    def fault_happened(self) -> bool:
        """That of `when_pressing`."""
        return self._fault_ns is not None

    def _keep_time(self) -> None:
        put_ahead(threading.get_native_id())
        before_s = time.monotonic()
        while not self._ended.wait(TICK_S):
            now_s = time.monotonic()
            self.latest_s = max(self.latest_s, now_s - before_s - TICK_S)
            self._pass(now_s - before_s)
            before_s = now_s

    def _pass(self, seconds: float) -> None:
        """Advance all devices; in real time the board's own process keeps its own."""
        self.machine.turn(seconds)
        self.gauge.turn(seconds)
        self._tell_field()
        if self._stepped and not self._without_board:
            self.tell(f"run {round(seconds * 1e6)}")
        if self._fault is not None and self.force_n > 0.5:
            self._fault_ns, fault, self._fault = self.clock.now_ns(), self._fault, None
            fault()
        if self._fault_ns is not None and self.lifted_after_s is None and self.rod_is_up():
            self.lifted_after_s = (self.clock.now_ns() - self._fault_ns) * 1e-9

    def _moved(self, place: list[float]) -> None:
        self._rod_mm = place
        x_mm, y_mm = place[0] - ORIGIN_MM[0], place[1] - ORIGIN_MM[1]
        self.force_n = max(0.0, SURFACE_MM - place[2]) / mm_per_n(x_mm, y_mm) * self.stiffening
        now = (x_mm, y_mm, self.force_n)
        if not self.truth or self.truth[-1][1:] != now:
            self.truth.append((self.clock.now_ns(), *now))

    def _tell_field(self) -> None:
        x_mm, y_mm = self._rod_mm[0] - ORIGIN_MM[0], self._rod_mm[1] - ORIGIN_MM[1]
        force_n = 0.0 if self.beside else self.force_n
        # A rod that touches nothing changes nothing, wherever it travels.
        now = (x_mm * (force_n > 0.0), y_mm * (force_n > 0.0), force_n, *self.knock_m, self.mounted)
        if now == self._told or self._without_board:
            return
        self._told = now
        magnet_t = self.magnet_field_t(now[0] * 1e-3, now[1] * 1e-3, force_n) if self.mounted else np.zeros((4, 3))
        field_t = self._pad.sensed(magnet_t + EARTH_T)
        with self._telling:
            self.board.field(field_t)
            if self._load_cell:
                self.board.tell(f"load {round(self.force_n / NEWTON_PER_COUNT) + COUNTS_AT_ZERO}")

    def record_baseline(self, *, bare: bool = False) -> None:
        """In simulated time."""
        pad = self._loaded().pad[0]
        self.mounted = not bare
        self.clock.sleep(0.1)
        with self._surroundings(), ThreadPoolExecutor(max_workers=1) as executor:
            feed = open_feed(self._loaded(), pad)
            assert isinstance(feed, DeviceFeed)
            wanted = BaselineRequest(pad.pad(), pad.tolerance.si(), bare=bare, replaced=False, duration_s=1.0)
            job = BaselineJob(wanted, stored(wanted.pad), feed.source, executor)
            while job.share < 1.0:  # the time that this computer then takes to judge them does not count
                self.clock.sleep(0.005)
                for frame in feed.poll(self.clock.now_ns()):
                    job.take(frame)
            feed.close()
        assert job.facts() is not None
        self.mounted = True
        self.clock.sleep(0.1)

    def collect(self, plan: str | Path, output: Path) -> dict[str, Any]:
        """The verb's own work, in simulated time. Raises CollectError like the verb."""
        config = self._loaded()
        with self._surroundings():
            return collect(config, config.pad[0], str(plan), output, by_hand=False, clock=self.clock)

    def _loaded(self) -> CollectingConfig:
        return load_as(CollectingConfig, self.config)[0]

    @contextmanager
    def _surroundings(self) -> Iterator[None]:
        clock_ns = staticmethod(self.clock.now_ns if self._stepped else time.monotonic_ns)
        hang_s = STEPPED_HANG_S if self._stepped else guard.HANG_S
        with (
            patch.dict(os.environ, self.environment),
            patch.object(Bridge, "clock_ns", clock_ns),
            patch.object(guard, "HANG_S", hang_s),
        ):
            yield

    def magnet_field_t(self, x_m: float, y_m: float, force_n: float) -> np.ndarray:
        """(4, 3) at the sensors."""
        return magnet_field_t(self._pad, x_m, y_m, force_n, self.knock_m)

    def start(self, *arguments: str | Path) -> subprocess.Popen[str]:
        """A running verb of fmfts-daemon."""
        words: list[str | Path] = [sys.executable, "-m", "fmfts", *arguments, "--config", self.config]
        pipe = subprocess.PIPE
        process = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=self.environment)
        if "collect" in arguments:
            put_ahead(process.pid)
        return process

    def command(self, *arguments: str | Path, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
        """Runs a verb of fmfts-daemon to its end."""
        with self.start(*arguments) as process:
            try:
                out, errors = process.communicate(timeout=timeout_s)
            except BaseException:
                process.kill()
                raise
        return subprocess.CompletedProcess(process.args, process.returncode, out, errors)


def exact_pad() -> MountedPad:
    """Built as drawn."""
    return MountedPad.exact(PadConfig(name="left", source=SimulatedSource()).pad())


def magnet_field_t(mounted: MountedPad, x_m: float, y_m: float, force_n: float, knock_m: float | Array = 0.0) -> Array:
    """(4, 3) at the sensors; knock_m: the magnet is displaced by this."""
    position_m, axis = mounted.pose(*(np.full(4, value) for value in (x_m, y_m, force_n)))
    return cylinder_field(mounted.pad.sensors.position_m, position_m + knock_m, axis, mounted.pad.magnet)


def mm_per_n(x_mm: float, y_mm: float) -> float:
    """How far the rod sinks in at a place."""
    bend = max(0.0, 1.0 - (x_mm / HALF_SPAN_MM) ** 2) * max(0.0, 1.0 - (y_mm / HALF_SPAN_MM) ** 2)
    return EDGE_MM_PER_N + (CENTRE_MM_PER_N - EDGE_MM_PER_N) * bend**2


class KilledBench(PressedBench):
    """Ends this process with the rod down, as soon as the table has a number of presses."""

    def __init__(self, folder: Path, table: Path, presses: int, **options: Any) -> None:
        super().__init__(folder, **options)
        self._table, self._presses = table, presses

    def _pass(self, seconds: float) -> None:
        super()._pass(seconds)
        if self.force_n > 0.0 and self._table.exists():
            _, *rows = self._table.read_text().splitlines() or [""]
            if sum(not row.startswith("0,") for row in rows) >= self._presses:
                os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """FOLDER PLAN TABLE PRESSES: collect on a bench in FOLDER until the table has these presses, and be killed."""
    folder, plan, table = map(Path, sys.argv[1:4])
    with KilledBench(folder, table, int(sys.argv[4]), speed=1.0) as bench:
        bench.collect(plan, table)


if __name__ == "__main__":
    main()
