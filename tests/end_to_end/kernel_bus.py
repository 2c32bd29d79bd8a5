"""An emulated kernel I2C bus for real smbus2, and what reads from it."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import needed
from emulator.chips import LSB_PER_GAUSS
from fmfts.config import GeometryConfig, I2cSource, PadConfig
from fmfts.sensor import Frame
from fmfts.sensor.i2c.source import I2c
from fmfts.sources import on_i2c

SYSTEM_PYTHON = "/usr/bin/python3"
SERVER = Path(__file__).parents[1] / "emulator" / "i2c_kernel_bus.py"
PACKAGES = "umockdev, gir1.2-umockdev-1.0 and python3-gi"
PATIENCE_S = 60.0  # a limit for a busy machine; starting a reader takes half a second on an idle one


@cache  # all of /usr/lib is searched
def missing() -> bool:
    check = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
    libraries = list(Path("/usr/lib").glob("**/libumockdev-preload.so.0"))
    return not libraries or subprocess.run([SYSTEM_PYTHON, "-c", check], capture_output=True).returncode != 0


class KernelBus:
    """The server process and its readers; `order` changes what is on the bus."""

    def __init__(self, *chips: object, adapter: str, clock_hz: int | None) -> None:
        clock = [] if clock_hz is None else ["--clock-hz", str(clock_hz)]
        command = [SYSTEM_PYTHON, str(SERVER), "--adapter", adapter, *clock, *map(str, chips)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdin
        assert self.process.stdout
        self.root = self.process.stdout.readline().strip()
        assert self.root, "the emulated bus did not start"
        self._sources: list[I2c] = []

    def order(self, **what: object) -> str:
        assert self.process.stdin
        assert self.process.stdout
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()

    def chip(self, channel: int, mux: int = 0, **changes: object) -> None:
        assert self.order(chip=[mux, channel], set=changes) == "done"

    def report(self, **what: object) -> dict:
        """The bus's report right after the command `what`: no reader of it comes in between."""
        facts: dict = json.loads(self.order(report=True, **what))
        return facts

    def open(self, *pads: PadConfig) -> I2c:
        """A source that is closed with the bus."""
        self._sources.append(I2c({index: on_i2c(pad) for index, pad in enumerate(pads)}))
        return self._sources[-1]

    def stop(self) -> None:
        for source in self._sources:
            source.close()
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait(10)
        if self.process.stdout:
            self.process.stdout.close()


@contextmanager
def kernel_bus(*chips: object, adapter: str = "bcm2835", clock_hz: int | None = None) -> Iterator[KernelBus]:
    """Only processes that are started meanwhile see it. chips, adapter, and clock_hz (of the device tree): see
    i2c_kernel_bus.py."""
    if missing():
        needed.missing(PACKAGES)
    bus = KernelBus(*chips, adapter=adapter, clock_hz=clock_hz)
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("LD_PRELOAD", "libumockdev-preload.so.0")  # for the reader, our child; not for this process
            patch.setenv("UMOCKDEV_DIR", bus.root)
            yield bus
    finally:
        bus.stop()


def pad(name: str = "left", sensors: int = 4, **source: object) -> PadConfig:
    settings = {"bus": 7, "rate_hz": 75, "channels": tuple(range(sensors))} | source
    positions = tuple((float(i), 0.0, 0.0) for i in range(sensors))
    return PadConfig(name=name, source=I2cSource(**settings), geometry=GeometryConfig(sensors_mm=positions))  # type: ignore[arg-type]


def run(
    source: I2c, until: Callable[[list[Frame]], object], now_ns: Callable[[], int] = time.monotonic_ns
) -> list[Frame]:
    """Poll until the frames so far satisfy `until`; all of them."""
    frames: list[Frame] = []
    end = time.monotonic() + PATIENCE_S
    while not until(frames):
        assert time.monotonic() < end, f"still waiting: {source.state}, {len(frames)} frames"
        frames += source.poll(now_ns())
        time.sleep(0.002)
    return frames


def all_valid(frames: list[Frame]) -> bool:
    return bool(frames) and bool(frames[-1].valid.all())


def expected_counts(gain_code: int, sensors: int = 4, mux: int = 0) -> np.ndarray:
    fields = [(0.1 * (c + 1), -0.05 * (c + 1), 0.3 + mux) for c in range(sensors)]
    return np.rint(np.array(fields) * LSB_PER_GAUSS[gain_code])
