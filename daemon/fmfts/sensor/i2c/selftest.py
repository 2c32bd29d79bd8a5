"""The self-test of one pad on an I2C bus.

With a bias strap (HMC5983 data sheet 900425), with the chip's own field of nearly unknown strength (LIS3MDL, AN4602),
or with set and reset pulses (MMC5983MA).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from fmfts.sensor.chips.chip import Axes, Chip, OwnField, SetReset
from fmfts.sensor.chips.selftest import bridge_zero_counts, own_field_counts, selftest_failures, strap_counts, strap_of
from fmfts.sensor.i2c.pad import I2cPad, MuxError
from fmfts.sensor.i2c.sensor import Sensor
from fmfts.sensor.wire.packets import Selftest, SelftestSensor, SensorState

CONVERSION_LIMIT_S = 0.1  # twice the time of eight averaged conversions of 6 ms
POLL_S = 2e-3
NOTHING: Axes = (0, 0, 0)


def measure(pad: I2cPad, request_id: int, after_each: Callable[[], object] = lambda: None) -> Selftest:
    """Measure every sensor without bias and with it, then configure all as before. Blocks 0.1 to 0.3 s a sensor.

    after_each: called after each sensor, to report progress.
    """
    gain_code = _gain_code(pad.chip)
    sensors = []
    for sensor in pad.sensors:
        sensors.append(_measure_sensor(pad, sensor, gain_code))
        after_each()
    pad.configure(pad.settings)
    return Selftest(request_id, pad.index, gain_code, tuple(sensors))


def _gain_code(chip: Chip) -> int:
    if chip.set_reset is not None:
        return 0  # such a chip has one range
    return strap_of(chip).gain_code if chip.own_field is None else chip.own_field.gain_code


def _measure_sensor(pad: I2cPad, sensor: Sensor, gain_code: int) -> SelftestSensor:
    if sensor.state != SensorState.OK:
        # On a busy computer a sensor may be lost for a moment, so only its present answer counts.
        pad.try_again(sensor)
    if sensor.state != SensorState.OK:
        return SelftestSensor(sensor.state, NOTHING, NOTHING)
    try:
        pad.select(sensor)
        counts = _counts(pad, sensor)
    except MuxError:
        return SelftestSensor(SensorState.MUX_SILENT, NOTHING, NOTHING)
    except OSError:
        return SelftestSensor(SensorState.NO_ANSWER, NOTHING, NOTHING)
    if counts is None:
        return SelftestSensor(SensorState.NO_NEW_DATA, NOTHING, NOTHING)
    failed = selftest_failures(pad.chip, gain_code, *counts)
    return SelftestSensor(SensorState.SELFTEST_FAILED if failed else SensorState.OK, *counts)


def _counts(pad: I2cPad, sensor: Sensor) -> tuple[Axes, Axes] | None:
    """The counts for `selftest_facts`; None if a sample did not come in time."""
    if pad.chip.set_reset is not None:
        return _with_pulses(pad, sensor, pad.chip.set_reset)
    if pad.chip.own_field is not None:
        return _with_own_field(pad, sensor, pad.chip.own_field)
    return _with_strap(pad, sensor)


def _with_strap(pad: I2cPad, sensor: Sensor) -> tuple[Axes, Axes] | None:
    settings = strap_of(pad.chip).settings(pad.chip)
    unbiased, positive, negative = (_biased(pad, sensor, each) for each in settings)
    if unbiased is None or positive is None or negative is None:
        return None
    return strap_counts(pad.chip, unbiased, positive, negative)


def _with_own_field(pad: I2cPad, sensor: Sensor, test: OwnField) -> tuple[Axes, Axes] | None:
    without = _samples(pad, sensor, test.without, test.settle_s[0], test.samples)
    with_field = _samples(pad, sensor, test.with_field, test.settle_s[1], test.samples)
    if without is None or with_field is None:
        return None
    return own_field_counts(pad.chip, without, with_field), NOTHING


def _with_pulses(pad: I2cPad, sensor: Sensor, test: SetReset) -> tuple[Axes, Axes] | None:
    """The bridges' zeros by set and reset, then what turning the coil's current over does. Set up again, it ends."""
    sensor.wires.write(test.stop)
    time.sleep(test.settle_s[0])
    after_set, after_reset, one_way, other_way = (
        _samples(pad, sensor, pulse, test.settle_s[1], test.samples, (*coil, test.measure))
        for pulse, *coil in (
            (test.set_pulse,),
            (test.reset_pulse,),
            (test.set_pulse, test.coil[0]),
            (test.set_pulse, test.coil[1]),
        )
    )
    if after_set is None or after_reset is None or one_way is None or other_way is None:
        return None
    return bridge_zero_counts(pad.chip, after_set, after_reset), own_field_counts(pad.chip, one_way, other_way)


def _samples(
    pad: I2cPad, sensor: Sensor, settings: bytes, settle_s: float, wanted: int, each: Sequence[bytes] = ()
) -> list[Axes] | None:
    """The counts of this many samples, without the first one, which may be older; None if one is late.

    each: what to write for every measurement of a chip that does not stream.
    """
    sensor.wires.write(settings)
    time.sleep(settle_s)
    found: list[Axes] = []
    for _ in range(1 + wanted):
        for data in each:
            sensor.wires.write(data)
        if each:
            time.sleep(pad.chip.single_wait_s)
        block = _next(pad, sensor)
        if block is None:
            return None
        found.append(pad.chip.driver.axes(pad.chip, block))
    return found[1:]


def _biased(pad: I2cPad, sensor: Sensor, settings: bytes) -> Axes | None:
    """Counts under the bias that `settings` makes; None if no conversion ended in time."""
    sensor.wires.write(settings)
    _single(pad, sensor)  # the first sample still has the old gain
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
        is_last = time.monotonic() >= end_s  # also on a busy computer that stalled meanwhile
        ready, block = pad.chip.driver.sample(sensor.wires)
        if ready or is_last:
            return block if ready else None
        time.sleep(POLL_S)
