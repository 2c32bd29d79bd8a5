"""The self-test of the LIS3MDL: a field that the chip makes itself tells broken axes, and no gains."""

from __future__ import annotations

from typing import Any

import pytest
from emulated_bus import Clock, clock, emulated_pad, run, selftest_of, with_

from emulator.magnetometers import Lis3mdl
from fmfts.cli.next_step import after_selftest
from fmfts.sensor.chips import LIS3MDL
from fmfts.sensor.chips.selftest import own_field_counts, selftest_facts, selftest_failures
from fmfts.sensor.i2c import selftest as i2c_selftest
from fmfts.sensor.wire.packets import Selftest, SensorState
from fmfts.sensor.wired_pad import PadOnBoard, PadOnI2c

__all__ = ["clock"]
FIELD_GAUSS = (0.75, -1.5, 0.3)
COUNTS_PER_GAUSS = 2281  # counts of a gauss at ±12 G (table 3)


def measured(clock: Clock, *chips: Lis3mdl, trigger: int = 0) -> Selftest:
    return selftest_of(clock, "lis3mdl", chips, trigger)


def chip(clock: Clock, field_gauss: tuple[float, float, float] = FIELD_GAUSS, **own: Any) -> Lis3mdl:
    made: Lis3mdl = with_(Lis3mdl(clock, field_gauss), **own)
    return made


@pytest.mark.parametrize("trigger", [0, 1])
def test_good_chips_pass_and_stream_as_before(clock: Clock, trigger: int) -> None:
    result = measured(clock, chip(clock), chip(clock, own_field_gauss=(-1.1, 2.9, 0.95)), trigger=trigger)
    assert (result.request_id, result.gain_code) == (7, 2)
    assert [sensor.state for sensor in result.sensors] == [SensorState.OK] * 2
    due = round(2.0 * COUNTS_PER_GAUSS), round(2.0 * COUNTS_PER_GAUSS), round(0.5 * COUNTS_PER_GAUSS)
    assert result.sensors[0].positive == pytest.approx(due, abs=1)
    assert result.sensors[1].positive == pytest.approx((-2509, 6615, 2167), abs=1)


def test_lis3mdl_selftest_follows_the_makers_note() -> None:
    test = LIS3MDL.own_field
    assert test is not None
    # CTRL_REG1 to 5: 80 Hz and low power, ±12 G, continuous; then the bit ST.
    assert (test.without, test.with_field) == (bytes.fromhex("a0 1c 40 00 00 40"), bytes.fromhex("20 1d"))
    assert (test.settle_s, test.samples) == ((0.020, 0.060), 5)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_axis_beyond_its_limits_fails_alone(clock: Clock, axis: int) -> None:
    for gauss in ((0.9, 3.1), (0.9, 3.1), (0.09, 1.01))[axis]:
        own = [2.0, 2.0, 0.5]
        own[axis] = gauss
        result = measured(clock, chip(clock, own_field_gauss=tuple(own)), chip(clock))
        assert [sensor.state for sensor in result.sensors] == [SensorState.SELFTEST_FAILED, SensorState.OK]
        (reason,) = selftest_failures(LIS3MDL, 2, result.sensors[0].positive, result.sensors[0].negative)
        name, counts, rest = reason.split(" ", 2)
        assert name == f"{'xyz'[axis]}:"
        assert int(counts) == pytest.approx(gauss * COUNTS_PER_GAUSS, abs=1)
        assert rest.endswith("the chip is damaged")


def test_field_without_room_for_the_coil_is_not_called_damage(clock: Clock) -> None:
    result = measured(clock, chip(clock, field_gauss=(11.0, 0.0, 0.0)))
    assert result.sensors[0].state == SensorState.SELFTEST_FAILED
    (reason,) = selftest_failures(LIS3MDL, 2, result.sensors[0].positive, result.sensors[0].negative)
    assert reason.startswith("x: saturated: the field outside")


def test_chip_that_gives_no_samples_any_more_is_not_judged(clock: Clock) -> None:
    one = chip(clock)
    pad, _ = emulated_pad(clock, "lis3mdl", [one], rate_hz=50)
    run(pad, clock, 0.5, 50)
    one.frozen = True
    assert i2c_selftest.measure(pad, 1).sensors[0].state == SensorState.NO_NEW_DATA


def test_samples_are_averaged_and_saturated_one_spoils_its_axis() -> None:
    bad = LIS3MDL.saturated_count
    assert own_field_counts(LIS3MDL, [(1, 10, 0), (3, 10, 0)], [(101, -90, 5), (103, -90, bad)]) == (100, -100, bad)


def test_facts_name_no_gain() -> None:
    facts = selftest_facts(LIS3MDL, 2, [(4562, 4562, 1140)], [(0, 0, 0)])
    assert (facts["passed"], facts["gain_factor_sd"]) == (True, None)
    (sensor,) = facts["sensors"]  # type: ignore[misc]
    assert sensor["gain_factor"] == [None, None, None]
    assert "new gains" not in after_selftest(facts, "", "")


def test_only_the_i2c_bus_has_this_test() -> None:
    """A board's firmware tests bias straps alone."""
    common = {"name": "left", "sensors": 2, "chip": LIS3MDL, "rate_hz": 80, "range_gauss": 4.0, "trigger": "free"}
    wiring = {"bus": 1, "clock_hz": 400_000, "mux_addresses": (), "channels": (), "addresses": (0x1C, 0x1E)}
    assert PadOnI2c(**common, **wiring).has_selftest
    assert not PadOnBoard(**common, port="/dev/null", baud=460_800, uid=None).has_selftest
