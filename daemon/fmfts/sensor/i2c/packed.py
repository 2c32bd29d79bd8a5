"""The packets of firmware/wire.md that a pad on an I2C bus makes of its sensors, as a board would."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmfts.sensor.chips import Chip
from fmfts.sensor.chips.chip import Axes
from fmfts.sensor.frame import AGE_UNKNOWN_US
from fmfts.sensor.i2c.reader_config import PadWiring
from fmfts.sensor.i2c.sensor import Sensor, now_us
from fmfts.sensor.wire.packets import (
    NO_MUX,
    TEMPERATURE_UNKNOWN,
    HelloPad,
    HelloSensor,
    Sample,
    SensorState,
    channel_byte,
)
from fmfts.sensor.wired_pad import Settings


def frame_of(sensors: Sequence[Sensor], chip: Chip, settings: Settings, index: int, sequence: int) -> Sample:
    """The last sample of every sensor, and its age."""
    valid = fresh = 0
    axes: list[Axes] = []
    times_us: list[int | None] = []
    temperatures: list[int] = []
    for place, one in enumerate(sensors):
        if one.state != SensorState.OK or one.sampled_us is None:
            axes.append((0, 0, 0))
            times_us.append(None)
            continue
        valid |= 1 << place
        fresh |= one.fresh << place
        axes.append(one.axes)
        times_us.append(one.sampled_us)
        raw = one.temperature_raw
        if raw != TEMPERATURE_UNKNOWN and chip.temperature_c(raw) is not None:
            temperatures.append(raw)
    newest_us = max((each for each in times_us if each is not None), default=None)
    if newest_us is None:
        newest_us = now_us()
    ages = [AGE_UNKNOWN_US if each is None else min(newest_us - each, AGE_UNKNOWN_US) for each in times_us]
    return Sample(
        index,
        sequence,
        newest_us,
        settings.gain_code,
        settings.trigger,
        valid,
        fresh,
        round(sum(temperatures) / len(temperatures)) if temperatures else TEMPERATURE_UNKNOWN,
        np.array(axes, np.int16),
        np.array(ages, np.uint16),
    )


def hello_of(sensors: Sequence[Sensor], wiring: PadWiring, bus_number: int) -> HelloPad:
    """Without a mux, the wire has 0 as its address, and the sensor's own address as the channel (firmware/wire.md)."""
    pad_mux = next(iter(wiring.mux_addresses), NO_MUX)
    return HelloPad(
        bus_number & 0xFF,
        pad_mux,
        tuple(
            HelloSensor(
                one.wires.address
                if one.mux_address is None or one.channel is None
                else channel_byte(pad_mux, one.mux_address, one.channel),
                one.state,
                one.identification,
            )
            for one in sensors
        ),
    )
