"""Each driver's transfers: every adapter of Linux accepts them, and they have as many bits as the chip states."""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import pytest
from emulated_bus import Clock, clock, emulated_pad, run

from emulator import magnetometers
from emulator.chips import Hmc5983
from emulator.i2c_adapters import ADAPTERS, I2C, READ, Message
from emulator.mlx90393 import Mlx90393
from fmfts.sensor.chips import CHIPS, Chip
from fmfts.sensor.chips.rates import BusLoad, i2c_cycle_s
from fmfts.sensor.i2c import selftest as i2c_selftest
from fmfts.sensor.i2c.bus import ChipWires

__all__ = ["clock"]
READ_ON_I2C = [chip for chip in CHIPS.values() if not chip.streamed]
# `ft260_i2c_write_read` of hid-ft260.c: at most two bytes before a read. The MLX90393's registers are written so.
REFUSED_BY = {("mlx90393", "ft260")}


def emulated(chip: Chip, clock: Clock, **options: Any) -> Any:
    known: dict[str, type] = {"hmc5983": Hmc5983, "hmc5883l": Hmc5983, "mlx90393": Mlx90393}
    kinds = known | {name.lower(): kind for name, kind in vars(magnetometers).items() if isinstance(kind, type)}
    return kinds[chip.name](clock, field_gauss=(0.3, -0.2, 0.5), **options)


def settings_of(chip: Chip) -> list[tuple[int, int]]:
    """Rate and trigger."""
    free = [(min(chip.free_rate_hz, 200), 0)]
    return [*free, (min(chip.single_rate_hz, 100), 1)] if chip.has_trigger else free


def listen(bus: Any) -> list[Sequence[tuple[int, bytes | int]]]:
    """All transfers on this emulated bus from now on."""
    heard: list[Sequence[tuple[int, bytes | int]]] = []
    transfer = bus.transfer
    bus.transfer = lambda messages: (heard.append(messages), transfer(messages))[1]
    return heard


def refusal(adapter: str, transfer: Sequence[tuple[int, bytes | int]]) -> int:
    messages = [
        Message(address, READ, what) if isinstance(what, int) else Message(address, 0, len(what))
        for address, what in transfer
    ]
    return ADAPTERS[adapter].refusal(messages)


@pytest.mark.parametrize("adapter", [name for name, each in ADAPTERS.items() if each.functions & I2C])
@pytest.mark.parametrize("chip", READ_ON_I2C, ids=lambda chip: chip.name)
def test_driver_asks_nothing_that_an_adapter_refuses(chip: Chip, adapter: str, clock: Clock) -> None:
    refused = set()
    for rate_hz, trigger in settings_of(chip):
        pad, bus = emulated_pad(clock, chip.name, [emulated(chip, clock)], rate_hz=rate_hz, trigger=trigger)
        heard = listen(bus.bus)
        run(pad, clock, 2.0, rate_hz)
        assert pad.sensors[0].sampled_us is not None
        if chip.bias_strap is not None or chip.tested_on_i2c:
            i2c_selftest.measure(pad, 1)
        for other in READ_ON_I2C:
            with suppress(OSError):  # nothing answers
                other.driver.identify(ChipWires(bus, chip.address), other)  # type: ignore[arg-type]
        assert len(heard) > 100
        assert all(sum(isinstance(what, int) for _, what in transfer) <= 1 for transfer in heard)
        refused |= {refusal(adapter, transfer) for transfer in heard} - {0}
    assert refused == ({errno.EOPNOTSUPP} if (chip.name, adapter) in REFUSED_BY else set())


@pytest.mark.parametrize("chip", READ_ON_I2C, ids=lambda chip: chip.name)
def test_sample_bits_are_those_on_the_wires(chip: Chip, clock: Clock) -> None:
    """For nearly every sample: a driver may ask for more now and then, to maintain its chip."""
    for rate_hz, trigger in settings_of(chip):
        pad, bus = emulated_pad(clock, chip.name, [emulated(chip, clock)], rate_hz=rate_hz, trigger=trigger)
        run(pad, clock, 0.5, rate_hz)
        bits = []
        for _ in range(500):
            if trigger:
                before = bus.bus.bit_times
                bus.write(chip.address, chip.driver.trigger)
                assert bus.bus.bit_times - before == chip.driver.trigger_bits
            clock.sleep(1.1 / rate_hz)
            before = bus.bus.bit_times
            ready, block = chip.driver.sample(ChipWires(bus, chip.address))  # type: ignore[arg-type]
            assert ready
            assert block is not None
            bits.append(bus.bus.bit_times - before)
        usual, times = Counter(bits).most_common(1)[0]
        assert usual == chip.driver.sample_bits
        # A QMC5883P is read again where a sample ends within the two transfers that follow its status: 0.4 of 5 ms.
        assert times >= (460 if chip.name == "qmc5883p" else 490)


@pytest.mark.parametrize("chip", READ_ON_I2C, ids=lambda chip: chip.name)
def test_cycle_is_as_long_as_all_bits_of_a_reading(chip: Chip, clock: Clock) -> None:
    """Four chips behind a mux: each selected and read, and the mux's byte read back."""
    for rate_hz, trigger in settings_of(chip):
        pad, bus = emulated_pad(clock, chip.name, [emulated(chip, clock) for _ in range(4)], rate_hz=rate_hz)
        pad.configure(type(pad.settings)(0, rate_hz, trigger))
        run(pad, clock, 0.5, rate_hz)
        lengths = []
        for _ in range(100):
            clock.sleep(1.1 / rate_hz)
            before = bus.bus.bit_times
            converted_us = pad.trigger() if trigger else None
            if trigger:
                clock.sleep(chip.single_wait_s)
            pad.poll(converted_us)
            assert pad.mux_misuse() is None
            lengths.append(bus.bus.bit_times - before)
            assert pad.sample().fresh == 0b1111
        mode = "simultaneous" if trigger else "free"
        cycle_bits = i2c_cycle_s(chip, 100_000, BusLoad(4, 1), mode) * 100_000
        assert Counter(lengths).most_common(1)[0][0] == pytest.approx(cycle_bits)
