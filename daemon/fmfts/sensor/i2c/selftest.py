"""The self-test of one pad on an I2C bus.

With a bias strap (HMC5983 data sheet 900425), or with a field of the chip's own that is hardly known (LIS3MDL, AN4602).
"""

from __future__ import annotations

import time
from collections.abc import Callable

from fmfts.sensor.chips.chip import Axes, OwnField
from fmfts.sensor.chips.selftest import own_field_counts, selftest_failures, strap_counts, strap_of
from fmfts.sensor.i2c.pad import I2cPad, MuxError
from fmfts.sensor.i2c.sensor import Sensor
from fmfts.sensor.wire.packets import Selftest, SelftestSensor, SensorState

CONVERSION_LIMIT_S = 0.1  # twice the time of eight averaged conversions of 6 ms
POLL_S = 2e-3
NOTHING: Axes = (0, 0, 0)


def measure(pad: I2cPad, request_id: int, after_each: Callable[[], object] = lambda: None) -> Selftest:
    """Measure every sensor without bias and with it, then configure all as before. Blocks 0.1 to 0.3 s a sensor.

    after_each: called after each sensor, so that whoever waits hears that the work goes on.
    """
    test = pad.chip.own_field
    gain_code = strap_of(pad.chip).gain_code if test is None else test.gain_code
    sensors = []
    for sensor in pad.sensors:
        sensors.append(_measure_sensor(pad, sensor, gain_code))
        after_each()
    pad.configure(pad.settings)
    return Selftest(request_id, pad.index, gain_code, tuple(sensors))


def _measure_sensor(pad: I2cPad, sensor: Sensor, gain_code: int) -> SelftestSensor:
    if sensor.state != SensorState.OK:
        return SelftestSensor(sensor.state, NOTHING, NOTHING)
    test = pad.chip.own_field
    try:
        pad.select(sensor)
        counts = _with_strap(pad, sensor) if test is None else _with_own_field(pad, sensor, test)
    except MuxError:
        return SelftestSensor(SensorState.MUX_SILENT, NOTHING, NOTHING)
    except OSError:
        return SelftestSensor(SensorState.NO_ANSWER, NOTHING, NOTHING)
    if counts is None:
        return SelftestSensor(SensorState.NO_NEW_DATA, NOTHING, NOTHING)
    failed = selftest_failures(pad.chip, gain_code, *counts)
    return SelftestSensor(SensorState.SELFTEST_FAILED if failed else SensorState.OK, *counts)


def _with_strap(pad: I2cPad, sensor: Sensor) -> tuple[Axes, Axes] | None:
    settings = strap_of(pad.chip).settings(pad.chip)
    unbiased, positive, negative = (_biased(pad, sensor, each) for each in settings)
    if unbiased is None or positive is None or negative is None:
        return None
    return strap_counts(pad.chip, unbiased, positive, negative)


def _with_own_field(pad: I2cPad, sensor: Sensor, test: OwnField) -> tuple[Axes, Axes] | None:
    measured = []
    for settings, settle_s in zip((test.without, test.with_field), test.settle_s, strict=True):
        sensor.wires.write(settings)
        time.sleep(settle_s)
        blocks = [_next(pad, sensor) for _ in range(1 + test.samples)][1:]  # the first may be of the time before
        measured.append([pad.chip.driver.axes(pad.chip, block) for block in blocks if block is not None])
        if len(measured[-1]) < test.samples:
            return None
    return own_field_counts(pad.chip, *measured), NOTHING


def _biased(pad: I2cPad, sensor: Sensor, settings: bytes) -> Axes | None:
    """Counts under the bias that `settings` makes; None if no conversion ended in time."""
    sensor.wires.write(settings)
    _single(pad, sensor)  # this one still has the old gain
    block = _single(pad, sensor)
    return None if block is None else pad.chip.driver.axes(pad.chip, block)


def _single(pad: I2cPad, sensor: Sensor) -> bytes | None:
    sensor.wires.write(pad.chip.driver.trigger)
    time.sleep(pad.chip.single_conversion_s)
    return _next(pad, sensor)


def _next(pad: I2cPad, sensor: Sensor) -> bytes | None:
    """The next sample; None if none comes in time."""
    end_s = time.monotonic() + CONVERSION_LIMIT_S
    while True:
        is_last = time.monotonic() >= end_s  # of a busy computer, which stood still meanwhile, as of any other
        ready, block = pad.chip.driver.sample(sensor.wires)
        if ready or is_last:
            return block if ready else None
        time.sleep(POLL_S)
