"""The self-test of the MMC5983MA: set and reset pulses tell the bridges' zeros, its coil tells broken axes."""

from __future__ import annotations

from typing import Any

import pytest
from emulated_bus import Clock, clock, emulated_pad, run, selftest_of, with_

from emulator.magnetometers import Mmc5983ma
from fmfts.cli.next_step import after_selftest
from fmfts.sensor.chips import LIS3MDL, MMC5983MA, QMC5883L
from fmfts.sensor.chips.selftest import bridge_zero_counts, no_selftest, selftest_facts, selftest_failures
from fmfts.sensor.i2c import selftest as i2c_selftest
from fmfts.sensor.wire.packets import Selftest, SensorState
from fmfts.sensor.wired_pad import PadOnBoard, PadOnI2c
from fmfts.view.facts import fact_lines

__all__ = ["clock"]
FIELD_GAUSS = (0.75, -2.4, 0.3)  # field of a magnet at rest; z out of the chip's face
COUNTS_PER_GAUSS = 4096  # of 16 bits
ZERO_GAUSS = (0.31, -0.08, 0.45)  # along the chip's own axes, z into the board


def measured(clock: Clock, *chips: Mmc5983ma, trigger: int = 0) -> Selftest:
    return selftest_of(clock, "mmc5983ma", chips, trigger)


def chip(clock: Clock, field_gauss: tuple[float, float, float] = FIELD_GAUSS, **own: Any) -> Mmc5983ma:
    """Its pulses leave the same zero each time, so that a test can tell it to a count."""
    made: Mmc5983ma = with_(Mmc5983ma(clock, field_gauss), repeatability_gauss=0.0, **own)
    return made


@pytest.mark.parametrize("trigger", [0, 1])
def test_zeros_are_distinguished_from_the_field(clock: Clock, trigger: int) -> None:
    result = measured(clock, chip(clock, zero_gauss=ZERO_GAUSS), chip(clock), trigger=trigger)
    assert (result.request_id, result.gain_code) == (7, 0)
    assert [sensor.state for sensor in result.sensors] == [SensorState.OK] * 2
    # Half a count from the mean, and one from each conversion, which drops two bits.
    assert result.sensors[0].positive == pytest.approx([each * COUNTS_PER_GAUSS for each in ZERO_GAUSS], abs=1.5)
    assert result.sensors[1].positive == pytest.approx((0, 0, 0), abs=1.5)
    assert result.sensors[0].negative == pytest.approx((-1024, -1024, -1024), abs=2)  # −2 · 0.125 G


def test_frame_without_a_field_reads_zero(clock: Clock) -> None:
    """With the frames' signs, z turned over: so that it is the zero that `baseline --bare` records."""
    one = chip(clock, zero_gauss=ZERO_GAUSS, field_gauss=(0.0, 0.0, 0.0))
    pad, _ = emulated_pad(clock, "mmc5983ma", [one], rate_hz=50)
    frame_t = run(pad, clock, 0.5, 50)[-1].counts[0] * MMC5983MA.step_t[0]
    (sensor,) = selftest_facts(MMC5983MA, 0, [i2c_selftest.measure(pad, 1).sensors[0].positive], [(-1024,) * 3])[  # type: ignore[misc]
        "sensors"
    ]
    assert sensor["zero_t"] == pytest.approx(frame_t, abs=0.05e-6)
    assert sensor["zero_t"] == pytest.approx([31e-6, -8e-6, -45e-6], abs=0.05e-6)


def test_noise_fails_no_good_chip(clock: Clock) -> None:
    chips = [Mmc5983ma(clock, FIELD_GAUSS, noise_gauss=0.8e-3, seed=seed) for seed in range(8)]
    pad, _ = emulated_pad(clock, "mmc5983ma", chips, rate_hz=50)
    run(pad, clock, 0.2, 50)
    result = i2c_selftest.measure(pad, 1)
    assert [sensor.state for sensor in result.sensors] == [SensorState.OK] * 8
    zeros = [count for sensor in result.sensors for count in sensor.positive]
    # Each pulse leaves a new zero, of 1 mG rms: half of both is 0.7 mG, three counts. Five of them.
    assert max(map(abs, zeros)) <= 15


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_zero_beyond_its_limit_fails_alone(clock: Clock, axis: int) -> None:
    zero = [0.49, -0.49, 0.49]
    zero[axis] = -0.52
    result = measured(clock, chip(clock, zero_gauss=tuple(zero)), chip(clock))
    assert [sensor.state for sensor in result.sensors] == [SensorState.SELFTEST_FAILED, SensorState.OK]
    (reason,) = selftest_failures(MMC5983MA, 0, result.sensors[0].positive, result.sensors[0].negative)
    told_ut = "+52.0" if axis == 2 else "-52.0"
    assert reason.startswith(f"{'xyz'[axis]}: its zero is {told_ut} µT, where ±50 are due: magnetised")


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_axis_that_does_not_measure_the_coil_is_dead(clock: Clock, axis: int) -> None:
    coil = [0.08, -0.175, 0.08]  # the coil's sign does not matter
    coil[axis] = 0.002
    result = measured(clock, chip(clock, coil_gauss=tuple(coil)), chip(clock, coil_gauss=(0.08, 0.175, -0.08)))
    assert [sensor.state for sensor in result.sensors] == [SensorState.SELFTEST_FAILED, SensorState.OK]
    (reason,) = selftest_failures(MMC5983MA, 0, result.sensors[0].positive, result.sensors[0].negative)
    assert reason.startswith(f"{'xyz'[axis]}: does not measure the chip's coil")


def test_samples_after_a_strong_field_are_ignored(clock: Clock) -> None:
    one = chip(clock)
    one.film.upset = True
    assert measured(clock, one).sensors[0].state == SensorState.OK


def test_field_without_room_for_the_coil_is_not_called_damage(clock: Clock) -> None:
    result = measured(clock, chip(clock, field_gauss=(0.0, 8.2, 0.0)))
    (reason,) = selftest_failures(MMC5983MA, 0, result.sensors[0].positive, result.sensors[0].negative)
    assert reason.startswith("y: saturated: the field outside")
    (sensor,) = selftest_facts(MMC5983MA, 0, [result.sensors[0].positive], [result.sensors[0].negative])[  # type: ignore[misc]
        "sensors"
    ]
    assert sensor["zero_t"][1] is None
    assert sensor["zero_t"][0] is not None


def test_chip_that_gives_no_samples_any_more_is_not_judged(clock: Clock) -> None:
    one = chip(clock)
    pad, _ = emulated_pad(clock, "mmc5983ma", [one], rate_hz=50)
    run(pad, clock, 0.5, 50)
    one.frozen = True
    assert i2c_selftest.measure(pad, 1).sensors[0].state == SensorState.NO_NEW_DATA


class Restless(Mmc5983ma):
    """Its first measurement after a pulse is off. `settings`: of each measurement, its bandwidth and its stream."""

    def __init__(self, *arguments: Any) -> None:
        self.since_pulse = 0
        self.settings: list[tuple[int, int]] = []
        self.repeatability_gauss = 0.0
        super().__init__(*arguments)

    def _pulse(self, polarity: int, time_s: float) -> None:
        super()._pulse(polarity, time_s)
        self.since_pulse = 0

    def convert(self) -> None:
        self.settings.append((self.controls[1], self.controls[2]))
        self.since_pulse += 1
        self.zero_gauss = (float(self.since_pulse == 1),) * 3
        super().convert()


def test_stream_rests_and_first_measurement_after_pulse_does_not_count(clock: Clock) -> None:
    one = Restless(clock, FIELD_GAUSS)
    pad, _ = emulated_pad(clock, "mmc5983ma", [one], rate_hz=200)
    run(pad, clock, 0.1, 200)
    one.settings.clear()
    result = i2c_selftest.measure(pad, 1)
    assert set(one.settings) == {(2, 0)}  # 2 ms, and no stream
    assert result.sensors[0].positive == pytest.approx((0, 0, 0), abs=1.5)
    assert result.sensors[0].negative == pytest.approx((-1024, -1024, -1024), abs=2)


def test_coil_is_off_afterwards(clock: Clock) -> None:
    one = chip(clock)
    measured(clock, one)
    assert one.controls[3] == 0


def test_saturated_sample_spoils_its_axis() -> None:
    bad = MMC5983MA.saturated_count
    assert bridge_zero_counts(MMC5983MA, [(9, 5, 3), (11, 5, 3)], [(-6, 5, bad), (-6, 5, 3)]) == (2, 5, bad)


def test_zeros_are_reported_in_microtesla_as_harmless() -> None:
    facts = selftest_facts(MMC5983MA, 0, [(1229, -410, 0)], [(-512, 512, -512)])
    assert (facts["passed"], facts["gain_factor_sd"]) == (True, None)
    lines = [line.strip() for line in fact_lines(facts)]
    assert "largest good zero: 50.000 µT" in lines
    assert "zero of each axis: (30.005, -10.010, 0.000) µT" in lines
    assert "`fmfts-daemon baseline --bare` while the pad is not mounted: it takes these zeros off" in after_selftest(
        facts, "", ""
    )


def test_sensor_that_does_not_answer_has_no_zero() -> None:
    facts = selftest_facts(MMC5983MA, 0, [(0, 0, 0)], [(0, 0, 0)], ["sensor 1 does not answer"])
    (sensor,) = facts["sensors"]  # type: ignore[misc]
    assert (sensor["zero_t"], sensor["failures"]) == ([None] * 3, ["sensor 1 does not answer"])


def test_only_the_i2c_bus_has_this_test() -> None:
    common = {"name": "left", "sensors": 1, "chip": MMC5983MA, "rate_hz": 80, "range_gauss": 8.0, "trigger": "free"}
    wiring = {"bus": 1, "clock_hz": 400_000, "mux_addresses": (0x70,), "channels": (0,), "addresses": (0x30,)}
    assert PadOnI2c(**common, **wiring).has_selftest
    assert not PadOnBoard(**common, port="/dev/null", baud=460_800, uid=None).has_selftest
    for one in (MMC5983MA, LIS3MDL):
        assert f"{one.named} is tested only on an I2C bus of the computer" in no_selftest(one)
    assert "a QMC5883L has no self-test" in no_selftest(QMC5883L)
