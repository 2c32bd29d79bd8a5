"""One pad behind two muxes, on emulated chips: the real `I2cPad`, and what it says of each sensor."""

from __future__ import annotations

import numpy as np
import pytest
from emulated_bus import Clock, EmulatedBus, clock, run  # noqa: F401

from emulator.chips import Bus, Hmc5983, Tca9548a
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import BusLoad, i2c_rate_hz
from fmfts.sensor.chips.tca9548a import Switches
from fmfts.sensor.i2c.pad import I2cPad
from fmfts.sensor.i2c.reader_config import PadWiring
from fmfts.sensor.wire.faults import identity, sensor_fault
from fmfts.sensor.wire.packets import Hello, SensorState
from fmfts.sensor.wired_pad import Settings

MUXES = (0x70,) * 8 + (0x71,) * 8
CHANNELS = (*range(8), *range(8))
RATE_HZ = 75


def wide_pad(clock: Clock, muxes: tuple[int, ...] = MUXES, trigger: int = 0) -> tuple[I2cPad, EmulatedBus]:  # noqa: F811
    """Sixteen HMC5983, whose x says which sensor it is: 0.05 G more for each. All have the same address."""
    emulated = [Tca9548a(address, {}) for address in sorted(set(muxes))]
    for number, (address, channel) in enumerate(zip(muxes, CHANNELS, strict=True)):
        chip = Hmc5983(clock, field_gauss=(0.05 * (number + 1), 0.1, 0.3), phase_s=0.0005 * number)
        emulated[address - 0x70].channels[channel] = chip
    bus = EmulatedBus(clock, Bus(emulated))
    wiring = PadWiring(muxes, CHANNELS, (0x1E,) * 16)
    pad = I2cPad(bus, Switches(bus, set(muxes)), wiring, 0, Settings(3, RATE_HZ, trigger), CHIPS["hmc5983"])  # type: ignore[arg-type]
    pad.configure(pad.settings)
    return pad, bus


@pytest.mark.parametrize("trigger", [0, 1], ids=["free", "simultaneous"])
@pytest.mark.parametrize(
    "muxes", [MUXES, tuple(0x70 + (each + one) % 2 for one in range(2) for each in range(8))], ids=["in turn", "mixed"]
)
def test_each_sensor_is_read_behind_its_own_mux_and_never_two_at_once(
    clock: Clock,  # noqa: F811
    muxes: tuple[int, ...],
    trigger: int,
) -> None:
    pad, bus = wide_pad(clock, muxes, trigger)
    sample = run(pad, clock, 1.0, RATE_HZ / 3)[-1]
    assert sample.valid == 0xFFFF
    assert sample.counts[:, 0].tolist() == np.rint(0.05 * np.arange(1, 17) * 660).tolist()
    assert bus.bus.conflicts == 0


def test_emulated_bus_counts_two_chips_behind_two_open_muxes(clock: Clock) -> None:  # noqa: F811
    """What the tests here rely on: the answers of both are mixed, and it is seen."""
    _, bus = wide_pad(clock)
    for address in (0x70, 0x71):
        bus.write(address, b"\x01")
    bus.exchange(0x1E, b"\x0a", 3)
    assert bus.bus.conflicts == 1


def test_silent_sensor_is_named_with_mux_and_channel(clock: Clock) -> None:  # noqa: F811
    pad, bus = wide_pad(clock)
    bus.bus.muxes[1].channels[4].absent = True
    sample = run(pad, clock, 1.0, RATE_HZ / 3)[-1]
    assert sample.valid == 0xFFFF & ~(1 << 12)
    told = sensor_fault(pad.describe(1), 12, pad.status().states[12], pad.chip)
    assert told == "sensor 13 (mux 0x71, channel 4) does not answer at 0x1E: check SDA/SCL of that channel"


def test_silent_mux_is_looked_for_among_the_pads_muxes(clock: Clock) -> None:  # noqa: F811
    pad, bus = wide_pad(clock)
    run(pad, clock, 0.5, RATE_HZ / 3)
    bus.bus.muxes[1].absent = True
    run(pad, clock, 1.0, RATE_HZ / 3)
    assert pad.status().states[12] == SensorState.MUX_SILENT
    told = sensor_fault(pad.describe(1), 12, SensorState.MUX_SILENT, pad.chip)
    assert told is not None
    assert told.startswith("sensor 13 (mux 0x71, channel 4) cannot be reached, mux 0x70 or 0x71 does not answer")
    bus.bus.muxes[1].absent = False
    assert run(pad, clock, 1.0, RATE_HZ / 3)[-1].valid == 0xFFFF
    assert bus.bus.conflicts == 0


def test_other_program_on_second_mux_costs_samples_and_is_named(clock: Clock) -> None:  # noqa: F811
    pad, bus = wide_pad(clock)
    run(pad, clock, 0.5, RATE_HZ / 3)
    assert pad.mux_misuse() is None
    bus.bus.muxes[1].control = bus.bus.muxes[1].pending = 0x01
    told = pad.mux_misuse()
    assert told is not None
    assert told.startswith("mux 0x71 on /dev/i2c-emulated: its control byte is 0x01")
    assert pad.sample().valid == 0


def test_probe_reports_the_mux_of_each_sensor(clock: Clock) -> None:  # noqa: F811
    pad, _ = wide_pad(clock)
    hello = Hello((0, 1, 0), 0, 0, bytes(12), RATE_HZ, 3, 0, 1, (pad.describe(1),))
    (told,) = identity(hello, pad.chip, has_selftest=True)["pads"]  # type: ignore[misc]
    assert told["mux_addresses"] == ["0x70"] * 8 + ["0x71"] * 8
    assert told["channels"] == list(CHANNELS)


def test_each_change_of_the_mux_costs_time_on_the_bus() -> None:
    chip = CHIPS["hmc5983"]
    behind_two, mixed, behind_one = (
        i2c_rate_hz(chip, "free", 400_000, BusLoad.of([(16, muxes)])) for muxes in (MUXES, MUXES[::8] * 8, (0x70,) * 16)
    )
    assert mixed < behind_two < behind_one
    assert behind_two == 168  # 16 times 39, 84 and 20 bits; twice 20 to change the mux, and 20 to read it back
