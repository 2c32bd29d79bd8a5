"""The sensors of one pad on an I2C bus. Each is set up, read, checked and repaired independently of the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

from fmfts.sensor.chips import Chip, tca9548a
from fmfts.sensor.chips.driver import Setup
from fmfts.sensor.chips.tca9548a import Switches
from fmfts.sensor.i2c import film
from fmfts.sensor.i2c.adapter import STUCK
from fmfts.sensor.i2c.bus import ChipWires, I2cBus
from fmfts.sensor.i2c.others import identity_of_another
from fmfts.sensor.i2c.packed import frame_of, hello_of
from fmfts.sensor.i2c.reader_config import PadWiring, ways
from fmfts.sensor.i2c.sensor import Sensor, now_us, period_us_of
from fmfts.sensor.wire.packets import TEMPERATURE_UNKNOWN, Early, HelloPad, Sample, SensorState, StatusPad
from fmfts.sensor.wired_pad import Settings

LOOK_US = 5_000_000
MISSES_UNTIL_LOST = 3  # a single NACK is noise
TRIGGER_TRIES = 3
UNREAD_US = 250_000  # besides two frames; it exceeds the set-up of a whole pad, which would otherwise not end
LATE_UNTIL_RESET = 2  # triggered measurements in a row that do not end: the chip lost its settings


class MuxError(Exception):
    """The mux did not take its selection; `cause` is the error of the bus."""

    def __init__(self, cause: OSError) -> None:
        super().__init__(str(cause))
        self.cause = cause


@dataclass(slots=True)
class I2cPad:
    """Reads the sensors of `wiring`, through `switches` if it has a mux.

    A frame needs `poll`, then `sample`; `watch` now and then.
    """

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
        self.sensors = [
            Sensor(ChipWires(self.bus, address), mux_address, channel)
            for mux_address, channel, address in ways(self.wiring)
        ]

    def configure(self, settings: Settings) -> None:
        """Set all sensors up with `settings`; `poll` tries again those that fail."""
        self.settings = settings
        for sensor in self.sensors:
            self._guard(sensor, self._set_up)

    def try_again(self, sensor: Sensor) -> None:
        """Set up a lost sensor, without waiting."""
        self._guard(sensor, self._set_up)

    def trigger(self) -> int:
        """Start a measurement in all working chips, those of one address behind one mux with one write.

        Returns the time (µs) of its middle.
        """
        working = [sensor for sensor in self.sensors if sensor.state == SensorState.OK]
        for mux_address, wires in dict.fromkeys((sensor.mux_address, sensor.wires) for sensor in working):
            alike = [one for one in working if (one.mux_address, one.wires) == (mux_address, wires)]
            for one in alike:
                one.started_measuring_us = 0
            try:
                channels = (one.channel for one in alike if one.channel is not None)
                self._select(mux_address, tca9548a.several(channels))
                wires.write(self.chip.driver.trigger)
            except (MuxError, OSError):
                self.bus_errors += 1  # the readings show which sensor failed
                continue
            for one in alike:
                one.started_measuring_us = now_us()
        return now_us() + self._half_us

    def poll(self, measured_us: int | None = None) -> None:
        """Read every working sensor once; set the others up again. measured_us: the time that `trigger` returned."""
        for sensor in self.sensors:
            if sensor.state == SensorState.OK:
                self._guard(sensor, self._read, measured_us)
            elif now_us() >= sensor.retry_us:
                self._guard(sensor, self._set_up)

    def sample(self) -> Sample:
        """The frame: the last sample of every sensor, and its age. Clears the fresh bits."""
        sample = frame_of(self.sensors, self.chip, self.settings, self.index, self.sequence)
        self.sequence = (self.sequence + 1) % 2**32
        for sensor in self.sensors:
            sensor.fresh = False
        return sample

    def early(self) -> list[Early]:
        """The samples that are in no frame yet, and that this did not return before."""
        found = []
        for number, one in enumerate(self.sensors):
            if one.state == SensorState.OK and one.fresh and one.unsent and one.sampled_us is not None:
                one.unsent = False
                found.append(Early(self.index, number, self.settings.gain_code, one.sampled_us, one.axes))
        return found

    def watch(self) -> None:
        """Check the registers of one sensor, by turns, and read its temperature."""
        sensor = self.sensors[self._turn % len(self.sensors)]
        self._turn += 1
        if sensor.state == SensorState.OK:
            self._guard(sensor, self._check)

    def mux_misuse(self) -> str | None:
        """A sentence if another program changed a mux. Samples may then be another sensor's, and are dropped."""
        for address in dict.fromkeys(self.wiring.mux_addresses):
            try:
                control = self.switches.foreign_control(address)
            except OSError:
                self.bus_errors += 1  # reading the sensors shows what is wrong
                continue
            if control is None:
                continue
            self.bus_errors += 1
            for sensor in self.sensors:
                sensor.sampled_us = None
            return (
                f"mux 0x{address:02x} on {self.bus.path}: its control byte is 0x{control:02x}, which this daemon did "
                "not write: another program uses the mux, or it was reset; stop that program"
            )
        return None

    def describe(self, bus_number: int) -> HelloPad:
        return hello_of(self.sensors, self.wiring, bus_number)

    def status(self) -> StatusPad:
        return StatusPad(self.bus_errors, 0, self.config_repairs, tuple(one.state for one in self.sensors))

    def select(self, sensor: Sensor) -> None:
        control = tca9548a.NO_CHANNEL if sensor.channel is None else tca9548a.one(sensor.channel)
        self._select(sensor.mux_address, control)

    @property
    def setup(self) -> Setup:
        return Setup(self.settings.gain_code, self.settings.rate_hz, bool(self.settings.trigger))

    def _select(self, address: int | None, control: int) -> None:
        """Connect only these channels of the mux at `address`. None: none at all."""
        self.bus.place = _place(address, control)
        try:
            self.switches.select(address, control)
        except OSError as error:
            raise MuxError(error) from error

    def _guard(self, sensor: Sensor, act: Callable[..., None], *others: int | None) -> None:
        """Run `act`; if it fails, count that against this sensor only."""
        try:
            act(sensor, *others)
            sensor.misses = 0
        except MuxError as error:
            self._missed(sensor, self._state_after(error.cause, SensorState.MUX_SILENT))
        except OSError as error:
            self._missed(sensor, self._state_after(error, SensorState.NO_ANSWER))

    def _state_after(self, error: OSError, otherwise: SensorState) -> SensorState:
        is_stuck = error.errno in STUCK and not self.bus.adapter.not_acknowledged(error)
        return SensorState.BUS_STUCK if is_stuck else otherwise

    def _missed(self, sensor: Sensor, state: SensorState) -> None:
        self.bus_errors += 1
        sensor.misses += 1
        if sensor.state != SensorState.OK or sensor.misses >= MISSES_UNTIL_LOST:
            sensor.lose(state)

    def _set_up(self, sensor: Sensor) -> None:
        driver, wires = self.chip.driver, sensor.wires
        self.select(sensor)
        try:
            sensor.identification = driver.identify(wires, self.chip)
        except OSError as error:
            self._look_for_another(sensor, error)
            if sensor.other is None:
                raise
            sensor.identification = sensor.other
        if not self.chip.is_identity(sensor.identification):
            other = identity_of_another(self.chip, self.bus, wires.address) if sensor.other is None else None
            sensor.identification = other or sensor.identification
            sensor.lose(SensorState.WRONG_IDENTIFICATION)
            return
        if not driver.set_up(wires, self.chip, self.setup):
            sensor.lose(SensorState.CONFIGURATION_LOST)
            return
        _, block = driver.sample(wires)
        sensor.begin(block, driver.stale_samples)
        if self._is_paced:
            self._start(sensor)

    def _look_for_another(self, sensor: Sensor, error: OSError) -> None:
        """Nothing acknowledges the sensor's address. Look for other chips now and then: each look costs frames."""
        if self.bus.adapter.not_acknowledged(error) and now_us() >= sensor.look_us:
            sensor.other = identity_of_another(self.chip, self.bus)
            sensor.look_us = now_us() + LOOK_US

    @property
    def _is_paced(self) -> bool:
        """Each chip is started again whenever it was read."""
        return self.chip.paced_by_host and not self.settings.trigger

    @property
    def _half_us(self) -> int:
        """From the start of a measurement to its middle."""
        return round(self.chip.single_conversion_s * 0.5e6)

    def _start(self, sensor: Sensor) -> None:
        sensor.started_measuring_us = 0
        sensor.wires.write(self.chip.driver.trigger)
        sensor.started_measuring_us = now_us()

    def _has_measured(self, sensor: Sensor, period_us: int) -> bool:
        """False for a chip that keeps its last sample, and got no new command, or too long ago."""
        if not self.chip.paced_by_host:
            return True
        running_us = now_us() - sensor.started_measuring_us
        return sensor.started_measuring_us > 0 and running_us < 2 * period_us + UNREAD_US

    def _read(self, sensor: Sensor, measured_us: int | None) -> None:
        period_us = period_us_of(self.chip, self.settings)
        if not self._has_measured(sensor, period_us):
            self.select(sensor)
            if self._is_paced:
                self._repair(sensor)  # its settings and its film may have changed meanwhile
            elif sensor.is_silent(period_us):
                sensor.lose(SensorState.NO_NEW_DATA)
            return
        for _ in range(1 if measured_us is None else TRIGGER_TRIES):
            self.select(sensor)
            before_us, sensor.polled_us = sensor.polled_us, now_us()
            ready, block = self.chip.driver.sample(sensor.wires)
            if ready or block not in (None, sensor.block):
                break
        if self.chip.paced_by_host and not ready:
            self._late(sensor, period_us)
        elif block is not None and (self.chip.paced_by_host or sensor.is_new(ready, block, period_us)):
            if measured_us is None and self._is_paced:
                measured_us = sensor.started_measuring_us + self._half_us
            elif measured_us is None:
                # A free-running chip converted between the last poll and this one: the middle has the smallest error.
                measured_us = max((before_us + sensor.polled_us) // 2, sensor.polled_us - period_us)
            axes = self.chip.driver.axes(self.chip, block)
            sensor.take(block, film.undisturbed(self.chip, self.settings.gain_code, sensor, axes), measured_us)
            sensor.late = 0
            if film.is_due(self.chip, sensor):
                film.magnetise(self.chip, sensor)  # now, while no measurement is running
            if self._is_paced:
                self._start(sensor)
        elif sensor.is_silent(period_us):
            sensor.lose(SensorState.NO_NEW_DATA)

    def _late(self, sensor: Sensor, period_us: int) -> None:
        """A measurement that was started has not ended. One that takes too long is of a chip that was reset."""
        sensor.late += 1
        running_us = now_us() - sensor.started_measuring_us
        too_late = running_us > 2e6 * self.chip.single_wait_s if self._is_paced else sensor.late >= LATE_UNTIL_RESET
        if sensor.is_silent(period_us) or (too_late and sensor.sampled_us is None):
            sensor.lose(SensorState.NO_NEW_DATA)
        elif too_late:
            self._repair(sensor)

    def _repair(self, sensor: Sensor) -> None:
        self.config_repairs += 1
        self._set_up(sensor)

    def _check(self, sensor: Sensor) -> None:
        self.select(sensor)
        if not self.chip.driver.is_set_up(sensor.wires, self.chip, self.setup):
            self._repair(sensor)
        if self.chip.thermometer is not None:
            count = self.chip.driver.temperature_count(sensor.wires, sensor.block)
            sensor.temperature_raw = TEMPERATURE_UNKNOWN if count is None else count


@lru_cache(maxsize=256)
def _place(address: int | None, control: int) -> str:
    return "no mux" if address is None else f"mux 0x{address:02x}, channels 0b{control:08b}"
