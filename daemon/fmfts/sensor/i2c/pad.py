"""The sensors of one pad on an I2C bus. Each is set up, read, checked and repaired independently of the others."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from fmfts.sensor.chips import Chip, hmc5983, tca9548a
from fmfts.sensor.chips.hmc5983 import ADDRESS
from fmfts.sensor.chips.tca9548a import Switches
from fmfts.sensor.frame import AGE_UNKNOWN_US
from fmfts.sensor.i2c.bus import I2cBus
from fmfts.sensor.i2c.reader_config import PadWiring
from fmfts.sensor.i2c.sensor import Sensor, now_us
from fmfts.sensor.wire.packets import TEMPERATURE_UNKNOWN, HelloPad, HelloSensor, Sample, SensorState, StatusPad
from fmfts.sensor.wired_pad import Settings

MISSES_UNTIL_LOST = 3  # a single NACK is noise
TRIGGER_TRIES = 3


class MuxError(Exception):
    """The mux did not take its selection; `cause` is the error of the bus."""

    def __init__(self, cause: OSError) -> None:
        super().__init__(str(cause))
        self.cause = cause


@dataclass(slots=True)
class I2cPad:
    """Reads the sensors of `wiring` through `switches`. A frame needs `poll`, then `sample`; `watch` now and then."""

    bus: I2cBus
    switches: Switches
    wiring: PadWiring
    index: int
    settings: Settings
    chip: Chip
    sensors: list[Sensor] = field(init=False)
    sequence: int = 0
    bus_errors: int = 0
    config_repairs: int = 0
    _turn: int = 0

    def __post_init__(self) -> None:
        self.sensors = [Sensor(channel) for channel in self.wiring.channels]

    def configure(self, settings: Settings) -> None:
        """Set all sensors up with `settings`; `poll` tries again those that fail."""
        self.settings = settings
        for sensor in self.sensors:
            self._guard(sensor, self._set_up)

    def trigger(self) -> int:
        """Start a conversion in all working chips with one write. Returns the time (µs) at which it will have ended."""
        channels = [sensor.channel for sensor in self.sensors if sensor.state == SensorState.OK]
        if channels:
            try:
                self._select(tca9548a.several(channels))
                self.bus.write(ADDRESS, bytes((hmc5983.MODE, hmc5983.MODE_SINGLE)))
            except (MuxError, OSError):
                self.bus_errors += 1  # reading each sensor shows which one failed
        return now_us() + round(self.chip.single_conversion_s * 1e6)

    def poll(self, converted_us: int | None = None) -> None:
        """Read every working sensor once; set the others up again. converted_us: when a trigger's conversion ended."""
        for sensor in self.sensors:
            if sensor.state == SensorState.OK:
                self._guard(sensor, lambda one: self._read(one, converted_us))
            elif now_us() >= sensor.retry_us:
                self._guard(sensor, self._set_up)

    def sample(self) -> Sample:
        """The frame: the last sample of every sensor, and its age. Clears the fresh bits."""
        usable = [one if one.state == SensorState.OK and one.sampled_us is not None else None for one in self.sensors]
        newest_us = max((one.sampled_us or 0 for one in usable if one), default=now_us())
        ages = [AGE_UNKNOWN_US if one is None else newest_us - (one.sampled_us or 0) for one in usable]
        told = [one.temperature_raw for one in usable if one and one.temperature_raw != TEMPERATURE_UNKNOWN]
        temperatures = [raw for raw in told if self.chip.temperature_c(raw) is not None]
        sample = Sample(
            self.index,
            self.sequence,
            newest_us,
            self.settings.gain_code,
            self.settings.trigger,
            _mask(one is not None for one in usable),
            _mask(one is not None and one.fresh for one in usable),
            round(sum(temperatures) / len(temperatures)) if temperatures else TEMPERATURE_UNKNOWN,
            np.array([(0, 0, 0) if one is None else one.axes for one in usable], np.int16),
            np.minimum(ages, AGE_UNKNOWN_US).astype(np.uint16),
        )
        self.sequence = (self.sequence + 1) % 2**32
        for sensor in self.sensors:
            sensor.fresh = False
        return sample

    def watch(self) -> None:
        """Check the registers of one sensor, by turns, and read its temperature."""
        sensor = self.sensors[self._turn % len(self.sensors)]
        self._turn += 1
        if sensor.state == SensorState.OK:
            self._guard(sensor, self._check)

    def mux_misuse(self) -> str | None:
        """A sentence if the mux is not as this process left it. Samples may then be another sensor's: drops them."""
        address = self.wiring.mux_address
        try:
            control = self.switches.foreign_control(address)
        except OSError:
            self.bus_errors += 1  # reading the sensors shows what is wrong
            return None
        if control is None:
            return None
        self.bus_errors += 1
        for sensor in self.sensors:
            sensor.sampled_us = None
        return (
            f"mux 0x{address:02x} on {self.bus.path}: its control byte is 0x{control:02x}, which this daemon did not "
            "write: another program uses the mux, or it was reset; stop that program"
        )

    def describe(self, bus_number: int) -> HelloPad:
        sensors = tuple(HelloSensor(one.channel, one.state, one.identification) for one in self.sensors)
        return HelloPad(bus_number & 0xFF, self.wiring.mux_address, sensors)

    def status(self) -> StatusPad:
        return StatusPad(self.bus_errors, 0, self.config_repairs, tuple(one.state for one in self.sensors))

    def select(self, sensor: Sensor) -> None:
        self._select(tca9548a.one(sensor.channel))

    def registers(self) -> bytes:
        """The wanted content of configuration registers A and B."""
        rate_hz = 15 if self.settings.trigger else self.settings.rate_hz  # single measurements do not use it
        return bytes((hmc5983.config_a(self.chip, rate_hz), hmc5983.config_b(self.settings.gain_code)))

    def _select(self, control: int) -> None:
        self.bus.place = f"mux 0x{self.wiring.mux_address:02x}, channels 0b{control:08b}"
        try:
            self.switches.select(self.wiring.mux_address, control)
        except OSError as error:
            raise MuxError(error) from error

    def _guard(self, sensor: Sensor, act: Callable[[Sensor], None]) -> None:
        """Run `act`; if it fails, count that against this sensor only."""
        try:
            act(sensor)
            sensor.misses = 0
        except MuxError as error:
            self._missed(sensor, _state_after(error.cause, SensorState.MUX_SILENT))
        except OSError as error:
            self._missed(sensor, _state_after(error, SensorState.NO_ANSWER))

    def _missed(self, sensor: Sensor, state: SensorState) -> None:
        self.bus_errors += 1
        sensor.misses += 1
        if sensor.state != SensorState.OK or sensor.misses >= MISSES_UNTIL_LOST:
            sensor.lose(state)

    def _set_up(self, sensor: Sensor) -> None:
        self.select(sensor)
        sensor.identification = self.bus.read_register(ADDRESS, hmc5983.IDENTIFICATION, len(self.chip.identity))
        if self.chip.why_not_identity(sensor.identification):
            sensor.lose(SensorState.WRONG_IDENTIFICATION)
            return
        wanted = self.registers()
        self.bus.write(ADDRESS, bytes((hmc5983.CONFIG_A,)) + wanted)
        if self.bus.read_register(ADDRESS, hmc5983.CONFIG_A, 2) != wanted:
            sensor.lose(SensorState.CONFIGURATION_LOST)
            return
        if not self.settings.trigger:
            self.bus.write(ADDRESS, bytes((hmc5983.MODE, hmc5983.MODE_CONTINUOUS)))
        _, block = self.bus.read_status_and_axes()
        sensor.begin(block)

    def _read(self, sensor: Sensor, converted_us: int | None) -> None:
        for _ in range(1 if converted_us is None else TRIGGER_TRIES):
            self.select(sensor)
            before_us, sensor.polled_us = sensor.polled_us, now_us()
            status, block = self.bus.read_status_and_axes()
            if status & hmc5983.STATUS_READY or block != sensor.block:
                break
        period_us = self._period_us()
        if sensor.is_new(status, block, period_us):
            # A free-running chip converted between the last poll and this one: the middle has the smallest error.
            guess_us = max((before_us + sensor.polled_us) // 2, sensor.polled_us - period_us)
            sensor.take(block, guess_us if converted_us is None else converted_us)
        elif sensor.is_silent(period_us):
            sensor.lose(SensorState.NO_NEW_DATA)

    def _check(self, sensor: Sensor) -> None:
        self.select(sensor)
        if self.bus.read_register(ADDRESS, hmc5983.CONFIG_A, 2) != self.registers():
            self.config_repairs += 1
            self._set_up(sensor)
        if self.chip.thermometer is not None:
            raw = self.bus.read_register(ADDRESS, hmc5983.TEMPERATURE, 2)
            sensor.temperature_raw = int.from_bytes(raw, "big", signed=True)

    def _period_us(self) -> int:
        if self.settings.trigger:
            return round(1e6 / self.settings.rate_hz)
        return round(1e6 / self.chip.output_rate_hz(self.settings.rate_hz))


def _state_after(error: OSError, otherwise: SensorState) -> SensorState:
    return SensorState.BUS_STUCK if error.errno in (errno.ETIMEDOUT, errno.EAGAIN) else otherwise


def _mask(bits: Iterable[bool]) -> int:
    return sum(bit << place for place, bit in enumerate(bits))
