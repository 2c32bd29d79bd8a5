"""The real `I2cPad` and its drivers on emulated chips, in one process and on a clock of the test's own."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from emulator.chips import Bus, NackError, Tca9548a
from fmfts.sensor.chips import CHIPS, memsic, mlx90393
from fmfts.sensor.chips.tca9548a import Switches
from fmfts.sensor.i2c import film as film_module
from fmfts.sensor.i2c import packed as packed_module
from fmfts.sensor.i2c import pad as pad_module
from fmfts.sensor.i2c import selftest as i2c_selftest
from fmfts.sensor.i2c import sensor as sensor_module
from fmfts.sensor.i2c.adapter import Adapter
from fmfts.sensor.i2c.pad import I2cPad
from fmfts.sensor.i2c.reader_config import PadWiring
from fmfts.sensor.wire.packets import Selftest
from fmfts.sensor.wired_pad import Settings

TRANSFER_S = 2e-4


class Clock:
    """Advances when somebody sleeps, and a little with each transfer."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s

    def now_us(self) -> int:
        return round(self.now_s * 1e6)


@contextmanager
def patched(clock: Clock) -> Iterator[None]:
    """Drivers sleep, and samples are stamped, on this clock."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (mlx90393, memsic, film_module):
            patch.setattr(module.time, "sleep", clock.sleep)
        for module in (pad_module, sensor_module, film_module, packed_module):
            patch.setattr(module, "now_us", clock.now_us)
        patch.setattr(i2c_selftest, "time", SimpleNamespace(sleep=clock.sleep, monotonic=clock))
        yield


@pytest.fixture
def clock() -> Iterator[Clock]:
    made = Clock()
    with patched(made):
        yield made


class EmulatedBus:
    """`I2cBus` on emulated chips. error: raised by every transfer while it is set."""

    path = "/dev/i2c-emulated"
    place = ""
    adapter = Adapter()

    def __init__(self, clock: Clock, bus: Bus) -> None:
        self.clock, self.bus = clock, bus
        self.error: OSError | None = None

    def _transfer(self, messages: Sequence[tuple[int, bytes | int]]) -> list[bytes]:
        self.clock.now_s += TRANSFER_S
        if self.error is not None:
            raise self.error
        try:
            return self.bus.transfer(messages)
        except NackError as error:
            raise OSError(errno.EREMOTEIO, "Remote I/O error") from error

    def write(self, address: int, data: bytes) -> None:
        self._transfer(((address, data),))

    def read(self, address: int, size: int) -> bytes:
        return self._transfer([(address, size)])[0]

    def exchange(self, address: int, data: bytes, count: int) -> bytes:
        return self._transfer([(address, data), (address, count)])[1]


def emulated_pad(
    clock: Clock,
    chip: str,
    chips: Sequence[Any],
    *,
    rate_hz: int = 200,
    gain_code: int = 0,
    trigger: int = 0,
    muxed: bool = True,
) -> tuple[I2cPad, EmulatedBus]:
    """A pad of these emulated chips, configured as `chip`: each behind a channel of its own, or at its own address."""
    bus = EmulatedBus(clock, Bus([Tca9548a(0x70, dict(enumerate(chips)))]) if muxed else Bus([], chips))
    addresses = (CHIPS[chip].address,) * len(chips) if muxed else tuple(one.address for one in chips)
    muxes, channels = ((0x70,) * len(chips), tuple(range(len(chips)))) if muxed else ((), ())
    wiring = PadWiring(muxes, channels, addresses)
    switches = Switches(bus, {0x70} if muxed else set())
    settings = Settings(gain_code, rate_hz, trigger)
    return I2cPad(bus, switches, wiring, 0, settings, CHIPS[chip]), bus  # type: ignore[arg-type]


def read(chip: Any, register: int, count: int = 1) -> bytes:
    """The answer of an emulated chip, without a driver."""
    chip.write(bytes((register,)))
    return bytes(chip.read(count))


def run(pad: I2cPad, clock: Clock, duration_s: float, rate_hz: float, watch_s: float = 0.25) -> list[Any]:
    """Samples of the pad, read as the reader does it: at a rate, with a watch of one sensor now and then."""
    samples = []
    next_s, watched_s, end_s = clock.now_s, clock.now_s, clock.now_s + duration_s
    while next_s < end_s:
        clock.now_s = max(clock.now_s, next_s)
        if pad.settings.trigger:
            converted_us = pad.trigger()
            clock.sleep(pad.chip.single_wait_s)
            pad.poll(converted_us)
        else:
            pad.poll()
        samples.append(pad.sample())
        if clock.now_s - watched_s > watch_s:
            watched_s = clock.now_s
            pad.watch()
        next_s = max(next_s + 1.0 / rate_hz, clock.now_s)
    return samples


def selftest_of(clock: Clock, kind: str, chips: Sequence[Any], trigger: int = 0) -> Selftest:
    """The self-test of a pad of these chips, whose samples before and after must be alike."""
    pad, _ = emulated_pad(clock, kind, chips, rate_hz=50, trigger=trigger)
    before = run(pad, clock, 0.5, 50)[-1]
    result = i2c_selftest.measure(pad, 7)
    after = run(pad, clock, 0.5, 50)[-1]
    assert after.valid == before.valid
    assert (after.counts == before.counts).all()
    return result


def with_(chip: Any, **own: Any) -> Any:
    """The emulated chip, with attributes of its own."""
    for name, value in own.items():
        setattr(chip, name, value)
    return chip
