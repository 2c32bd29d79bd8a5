"""The bias-strap measurement of one pad on an I2C bus (data sheet 900425, self-test operation)."""

from __future__ import annotations

import time

from fmfts.sensor.chips import hmc5983
from fmfts.sensor.chips.chip import Axes
from fmfts.sensor.chips.hmc5983 import ADDRESS
from fmfts.sensor.chips.selftest import selftest_failures, strap_counts
from fmfts.sensor.i2c.pad import I2cPad, MuxError
from fmfts.sensor.i2c.sensor import Sensor
from fmfts.sensor.wire.packets import Selftest, SelftestSensor, SensorState

RATE_HZ = 15  # from the data sheet's example; single measurements do not use it
CONVERSION_LIMIT_S = 0.1  # twice the time of eight averaged conversions of 6 ms
NOTHING: Axes = (0, 0, 0)


def measure(pad: I2cPad, request_id: int) -> Selftest:
    """Measure every sensor without bias and with both biases, then configure all as before. Blocks 0.1 s a sensor."""
    sensors = tuple(_measure_sensor(pad, sensor) for sensor in pad.sensors)
    pad.configure(pad.settings)
    return Selftest(request_id, pad.index, pad.chip.bias_strap.gain_code, sensors)


def _measure_sensor(pad: I2cPad, sensor: Sensor) -> SelftestSensor:
    if sensor.state != SensorState.OK:
        return SelftestSensor(sensor.state, NOTHING, NOTHING)
    try:
        pad.select(sensor)
        unbiased, positive, negative = (
            _biased(pad, bias) for bias in (hmc5983.BIAS_NONE, hmc5983.BIAS_POSITIVE, hmc5983.BIAS_NEGATIVE)
        )
    except MuxError:
        return SelftestSensor(SensorState.MUX_SILENT, NOTHING, NOTHING)
    except OSError:
        return SelftestSensor(SensorState.NO_ANSWER, NOTHING, NOTHING)
    if unbiased is None or positive is None or negative is None:
        return SelftestSensor(SensorState.NO_NEW_DATA, NOTHING, NOTHING)
    positive, negative = strap_counts(pad.chip, unbiased, positive, negative)
    failed = selftest_failures(pad.chip, pad.chip.bias_strap.gain_code, positive, negative)
    return SelftestSensor(SensorState.SELFTEST_FAILED if failed else SensorState.OK, positive, negative)


def _biased(pad: I2cPad, bias: int) -> Axes | None:
    """Counts under `bias`; None if no conversion ended in time."""
    config_a = hmc5983.config_a(pad.chip, RATE_HZ, bias, hmc5983.AVERAGE_8)
    config_b = hmc5983.config_b(pad.chip.bias_strap.gain_code)
    pad.bus.write(ADDRESS, bytes((hmc5983.CONFIG_A, config_a, config_b)))
    _single(pad)  # this one still has the old gain
    block = _single(pad)
    return None if block is None else hmc5983.axes_from_registers(block)


def _single(pad: I2cPad) -> bytes | None:
    pad.bus.write(ADDRESS, bytes((hmc5983.MODE, hmc5983.MODE_SINGLE)))
    end_s = time.monotonic() + CONVERSION_LIMIT_S
    while time.monotonic() < end_s:
        time.sleep(pad.chip.single_conversion_s)
        status, block = pad.bus.read_status_and_axes()
        if status & hmc5983.STATUS_READY:
            return block
    return None
