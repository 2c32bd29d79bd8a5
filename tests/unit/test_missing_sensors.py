"""A sensor that cannot be used is named with what it is, on which axis, and what to set."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.sensor.chips import CHIPS
from fmfts.sensor.frame import AGE_UNKNOWN_US, Frame
from fmfts.sensor.missing import missing_sensors

SATURATED = -4096


def frame(gain_code: int = 0) -> Frame:
    return Frame(
        pad_index=0,
        sequence=1,
        device_time_us=1_000_000,
        host_time_ns=1_000_000_000,
        gain_code=gain_code,
        counts=np.full((4, 3), 100, np.int16),
        age_us=np.zeros(4, np.uint16),
        fresh=np.ones(4, bool),
        valid=np.ones(4, bool),
        temperature_c=None,
        chip=CHIPS["hmc5983"],
    )


def test_complete_frame_has_no_missing_sensor() -> None:
    assert missing_sensors(frame(), np.zeros((4, 3), bool)) == {}


@pytest.mark.parametrize(
    ("gain_code", "said"),
    [
        (0, "saturated on x and z at ±0.88 G (set range_gauss = 1.3)"),
        (5, "saturated on x and z at ±4.7 G (set range_gauss = 5.6)"),
        (7, "saturated on x and z at ±8.1 G (no range is larger: is another magnet near?)"),
    ],
)
def test_saturation_names_the_axes_and_the_next_larger_range(gain_code: int, said: str) -> None:
    one = frame(gain_code)
    one.counts[1, [0, 2]] = SATURATED
    assert missing_sensors(one, np.zeros((4, 3), bool)) == {1: said}


def test_each_fault_is_called_by_its_name() -> None:
    one = frame()
    one.valid[0], one.age_us[0] = False, AGE_UNKNOWN_US
    one.counts[1, 1] = SATURATED
    stuck = np.zeros((4, 3), bool)
    stuck[3, 2] = True
    assert missing_sensors(one, stuck) == {
        0: "silent",
        1: "saturated on y at ±0.88 G (set range_gauss = 1.3)",
        3: "stuck on z, which repeats one value (run selftest)",
    }
