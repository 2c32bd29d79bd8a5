"""The bias-strap measurement of one pad on an I2C bus, of chips that have a strap (HMC5983 data sheet 900425)."""

from __future__ import annotations

import time

from fmfts.sensor.chips.chip import Axes, BiasStrap
from fmfts.sensor.chips.selftest import selftest_failures, strap_counts
from fmfts.sensor.i2c.pad import I2cPad, MuxError
from fmfts.sensor.i2c.sensor import Sensor
from fmfts.sensor.wire.packets import Selftest, SelftestSensor, SensorState

CONVERSION_LIMIT_S = 0.1  # twice the time of eight averaged conversions of 6 ms
NOTHING: Axes = (0, 0, 0)


def measure(pad: I2cPad, request_id: int) -> Selftest:
    """Measure every sensor without bias and with both biases, then configure all as before. Blocks 0.1 s a sensor."""
    strap = pad.chip.bias_strap
    assert strap is not None, "`Link.request_selftest` refuses a chip without one"
    sensors = tuple(_measure_sensor(pad, sensor, strap) for sensor in pad.sensors)
    pad.configure(pad.settings)
    return Selftest(request_id, pad.index, strap.gain_code, sensors)


def _measure_sensor(pad: I2cPad, sensor: Sensor, strap: BiasStrap) -> SelftestSensor:
    if sensor.state != SensorState.OK:
        return SelftestSensor(sensor.state, NOTHING, NOTHING)
    try:
        pad.select(sensor)
        unbiased, positive, negative = (_biased(pad, sensor, settings) for settings in strap.settings(pad.chip))
    except MuxError:
        return SelftestSensor(SensorState.MUX_SILENT, NOTHING, NOTHING)
    except OSError:
        return SelftestSensor(SensorState.NO_ANSWER, NOTHING, NOTHING)
    if unbiased is None or positive is None or negative is None:
        return SelftestSensor(SensorState.NO_NEW_DATA, NOTHING, NOTHING)
    positive, negative = strap_counts(pad.chip, unbiased, positive, negative)
    failed = selftest_failures(pad.chip, strap.gain_code, positive, negative)
    return SelftestSensor(SensorState.SELFTEST_FAILED if failed else SensorState.OK, positive, negative)


def _biased(pad: I2cPad, sensor: Sensor, settings: bytes) -> Axes | None:
    """Counts under the bias that `settings` makes; None if no conversion ended in time."""
    sensor.wires.write(settings)
    _single(pad, sensor)  # this one still has the old gain
    block = _single(pad, sensor)
    return None if block is None else pad.chip.driver.axes(pad.chip, block)


def _single(pad: I2cPad, sensor: Sensor) -> bytes | None:
    sensor.wires.write(pad.chip.driver.trigger)
    end_s = time.monotonic() + CONVERSION_LIMIT_S
    while time.monotonic() < end_s:
        time.sleep(pad.chip.single_conversion_s)
        ready, block = pad.chip.driver.sample(sensor.wires)
        if ready:
            return block
    return None
