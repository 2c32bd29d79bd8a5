"""The emulated MMC5983MA against its data sheet (Rev A) and what users measured, without any driver.

Page numbers are the data sheet's. Automatic set/reset: DRNadler/MMC5983MA_CompassTest. The sixteenth sample: SparkFun's
library, issues 9, 10 and 12. What the emulator chose without a source is in the head of emulator/memsic_film.py.
"""

from __future__ import annotations

import statistics
from typing import Any

import pytest
from emulated_bus import Clock, read

from emulator.magnetometers import Mmc5983ma

FIELD_GAUSS = (0.75, -1.5, 0.25)
AFTER_SET = [0.75, -1.5, -0.25]  # page 9: z points into the board
STATUS, CONTROL_0, CONTROL_1, CONTROL_2, CONTROL_3 = range(0x08, 0x0D)  # pages 13 to 16
MEASURE, SET, RESET, AUTOMATIC = 0x01, 0x08, 0x10, 0x20
MILLISECONDS = (8.0, 4.0, 2.0, 0.5)  # page 15, by bandwidth
STEP = 1 / 16384  # gauss of a count of 18 bits, page 2


@pytest.fixture
def clock() -> Clock:
    return Clock()


def made(clock: Clock, field_gauss: tuple[float, ...] = FIELD_GAUSS, bandwidth: int = 2, **own: Any) -> Mmc5983ma:
    """A chip after SET, whose pulses repeat exactly unless `own` says how well they do."""
    chip = Mmc5983ma(clock, field_gauss)
    chip.repeatability_gauss = 0.0
    for name, value in own.items():
        assert hasattr(chip, name)
        setattr(chip, name, value)
    chip.write(bytes((CONTROL_1, bandwidth)))
    pulse(clock, chip, SET)
    return chip


def pulse(clock: Clock, chip: Mmc5983ma, bit: int, pause_s: float = 1e-3) -> None:
    chip.write(bytes((CONTROL_0, bit)))
    clock.sleep(pause_s)


def outputs(chip: Mmc5983ma) -> list[float]:
    """x, y, z in gauss of all 18 bits (page 13)."""
    *axes, low = read(chip, 0x00, 7)
    counts = [axes[2 * i] << 10 | axes[2 * i + 1] << 2 | low >> 6 - 2 * i & 3 for i in range(3)]
    return [(count - 131072) / 16384 for count in counts]


def measured(clock: Clock, chip: Mmc5983ma, *bits: int) -> list[float]:
    chip.write(bytes((CONTROL_0, MEASURE | sum(bits))))
    clock.sleep(17.1e-3)
    assert read(chip, STATUS)[0] & 1
    return outputs(chip)


def is_done(chip: Mmc5983ma) -> bool:
    return bool(read(chip, STATUS)[0] & 1)


@pytest.mark.parametrize(("bandwidth", "automatic_ms"), list(enumerate((17.0, 9.0, 5.0, 2.0))))
@pytest.mark.parametrize("automatic", [0, AUTOMATIC])
def test_measurement_takes_the_time_of_its_bandwidth(
    clock: Clock, bandwidth: int, automatic_ms: float, automatic: int
) -> None:
    """With automatic set/reset twice the time and about 1 ms: 58/111/200/500 Hz, of which page 2 promises 50 to 580."""
    chip = made(clock, bandwidth=bandwidth)
    duration_s = (automatic_ms if automatic else MILLISECONDS[bandwidth]) * 1e-3
    chip.write(bytes((CONTROL_0, MEASURE | automatic)))
    clock.sleep(0.99 * duration_s)
    assert read(chip, STATUS) == b"\x10"
    clock.sleep(0.02 * duration_s)
    assert read(chip, STATUS) == b"\x11"


def test_done_bit_falls_at_the_command_and_stays_until_the_next(clock: Clock) -> None:
    chip = made(clock)
    measured(clock, chip)
    read(chip, 0x00, 7)
    clock.sleep(1.0)
    assert is_done(chip)
    chip.write(bytes((CONTROL_0, MEASURE)))
    assert not is_done(chip)
    clock.sleep(2.01e-3)
    assert is_done(chip)
    clock.sleep(1.0)
    assert chip.conversions == 2


@pytest.mark.parametrize(("clears", "status"), [(True, b"\x10"), (False, b"\x11")])
def test_writing_one_to_done_clears_it_or_only_its_interrupt(clock: Clock, clears: bool, status: bytes) -> None:
    """Page 14 can be read both ways."""
    chip = made(clock, writing_clears_done=clears)
    measured(clock, chip)
    chip.write(bytes((STATUS, 0x00)))
    assert read(chip, STATUS) == b"\x11"
    chip.write(bytes((STATUS, 0x01)))
    assert read(chip, STATUS) == status


def test_early_read_gives_the_old_sample(clock: Clock) -> None:
    chip = made(clock)
    assert measured(clock, chip) == AFTER_SET
    chip.feel((0.25, 0.0, 0.0))
    chip.write(bytes((CONTROL_0, MEASURE)))
    clock.sleep(1.9e-3)
    assert outputs(chip) == AFTER_SET
    clock.sleep(0.2e-3)
    assert outputs(chip) == [0.25, 0.0, 0.0]


def test_new_command_restarts_a_running_measurement(clock: Clock) -> None:
    chip = made(clock)
    for _ in range(3):
        chip.write(bytes((CONTROL_0, MEASURE)))
        clock.sleep(1.9e-3)
        assert not is_done(chip)
    clock.sleep(0.2e-3)
    assert is_done(chip)
    assert chip.conversions == 1


def test_sample_is_the_mean_field_of_its_measurement(clock: Clock) -> None:
    """A field that grows by 100 G/s: the sample is the field in the middle of the measurement."""
    chip = made(clock)
    begin_s = clock.now_s
    chip.field_at = lambda time_s: (100.0 * (time_s - begin_s), 0.0, -100.0 * (time_s - begin_s))
    chip.write(bytes((CONTROL_0, MEASURE)))
    clock.sleep(5e-3)
    assert outputs(chip) == pytest.approx([0.1, 0.0, 0.1], abs=STEP)
    begin_s = clock.now_s
    chip.write(bytes((CONTROL_0, MEASURE | AUTOMATIC)))  # samples from 0.5 to 2.5 ms and from 3 to 5 ms
    clock.sleep(6e-3)
    assert outputs(chip) == pytest.approx([0.275, 0.0, 0.275], abs=STEP)


@pytest.mark.parametrize(("field", "shown"), [(5 / 16384, 5 / 16384), (8.5, 131071 / 16384), (-8.5, -8.0)])
def test_mmc5983ma_counts_18_bits_up_to_8_gauss(clock: Clock, field: float, shown: float) -> None:
    assert measured(clock, made(clock, (field, -0.5, 7 / 16384))) == [shown, -0.5, -7 / 16384]


def test_settings_cannot_be_read_back(clock: Clock) -> None:
    chip = made(clock)
    chip.write(bytes((CONTROL_0, AUTOMATIC, 0x02, 0x8D, 0x40)))
    assert read(chip, CONTROL_0, 4) != b"\x20\x02\x8d\x40"
    assert len(set(read(chip, CONTROL_0, 4))) == 1


def test_reset_takes_10_ms_and_restores_8_ms_measurements(clock: Clock) -> None:
    chip = made(clock)
    chip.write(bytes((CONTROL_1, 0x80)))
    clock.sleep(9.9e-3)
    chip.write(bytes((CONTROL_0, MEASURE)))
    clock.sleep(20e-3)
    assert not is_done(chip)
    chip.write(bytes((CONTROL_1, 0x80)))
    clock.sleep(10e-3)
    chip.write(bytes((CONTROL_0, MEASURE)))
    clock.sleep(7.9e-3)
    assert not is_done(chip)
    clock.sleep(0.2e-3)
    assert is_done(chip)


# -- the film: page 18 and page 2 --


def test_pulses_turn_the_field_and_not_the_zero(clock: Clock) -> None:
    chip = made(clock, zero_gauss=(0.25, 0.125, -0.5))
    assert measured(clock, chip) == [1.0, -1.375, -0.75]
    pulse(clock, chip, RESET)
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]  # until the next pulse
    chip.write(bytes((CONTROL_1, 0x80)))
    clock.sleep(10e-3)
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]  # registers are reset, the film keeps its state
    chip.power_on()
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]


def test_new_part_may_be_in_reset_polarity(clock: Clock) -> None:
    assert measured(clock, Mmc5983ma(clock, FIELD_GAUSS)) == [-each for each in AFTER_SET]


def test_automatic_set_reset_removes_the_zero_and_leaves_reset(clock: Clock) -> None:
    chip = made(clock, zero_gauss=(0.25, 0.125, -0.5))
    assert measured(clock, chip, AUTOMATIC) == AFTER_SET
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]


def test_measurement_soon_after_a_pulse_is_wrong(clock: Clock) -> None:
    """The maker's code and ArduPilot pause 0.5 to 1 ms."""
    for pause_s, is_right in ((0.0, False), (0.1e-3, False), (0.4e-3, False), (0.5e-3, True), (1e-3, True)):
        chip = made(clock)
        pulse(clock, chip, SET, pause_s)
        largest = max(abs(a - b) for a, b in zip(measured(clock, chip), AFTER_SET, strict=True))
        assert (largest == 0.0) == is_right
        assert is_right or largest > 0.01
    chip = made(clock)
    assert measured(clock, chip, SET) != AFTER_SET  # both in one command


def test_pulse_in_a_measurement_spoils_it(clock: Clock) -> None:
    chip = made(clock)
    chip.write(bytes((CONTROL_0, MEASURE)))
    clock.sleep(1e-3)
    pulse(clock, chip, SET, 1.1e-3)
    assert is_done(chip)
    assert outputs(chip) != AFTER_SET
    assert measured(clock, chip) == AFTER_SET


def test_each_pulse_leaves_a_zero_of_1_mg_rms(clock: Clock) -> None:
    chip = made(clock, (0.0, 0.0, 0.0))
    assert Mmc5983ma.repeatability_gauss == 1e-3
    chip.repeatability_gauss = 1e-3
    zeros, automatic = [], []
    for _ in range(500):
        pulse(clock, chip, SET)
        zeros += measured(clock, chip)
        assert measured(clock, chip) == zeros[-3:]  # the same until the next pulse
        automatic += measured(clock, chip, AUTOMATIC, 0x04)
    assert statistics.pstdev(zeros) == pytest.approx(1e-3, rel=0.1)
    assert statistics.pstdev(automatic) == pytest.approx(1e-3 / 2**0.5, rel=0.1)  # half the difference of two


@pytest.mark.parametrize("bit", [SET, RESET])
@pytest.mark.parametrize("strong", [(10.1, 0.0, 0.0), (0.0, -6.0, 8.2), (5.9, 5.9, -5.9)])
def test_field_above_10_gauss_upsets_the_film_until_a_pulse(clock: Clock, bit: int, strong: tuple[float, ...]) -> None:
    """Page 2, "disturbing field": of the field itself, also while nothing is measured."""
    chip = made(clock)
    chip.feel(tuple(0.97 * each for each in strong))
    chip.feel(FIELD_GAUSS)
    assert measured(clock, chip) == AFTER_SET
    chip.feel(strong)
    pulse(clock, chip, bit)  # without effect: the field is still there
    chip.feel(FIELD_GAUSS)
    upset = measured(clock, chip)
    assert min(abs(abs(a) - abs(b)) for a, b in zip(upset, AFTER_SET, strict=True)) > 0.05
    assert measured(clock, chip) == upset
    pulse(clock, chip, bit)
    assert measured(clock, chip) == [each if bit == SET else -each for each in AFTER_SET]


def test_strong_field_shows_as_long_as_it_lasts(clock: Clock) -> None:
    chip = made(clock)
    chip.feel((0.5, 12.0, 0.0))
    assert measured(clock, chip)[1] == 131071 / 16384


def test_strong_field_upsets_the_film_when_set_or_moved(clock: Clock) -> None:
    for way in range(3):
        chip = made(clock)
        if way == 0:
            chip.field_gauss = [0.0, 10.1, 0.0]
        elif way == 1:
            chip.field_gauss[1] = 10.1
            is_done(chip)  # a transfer
        else:
            chip.field_at = lambda _: (0.0, 10.1, 0.0)
            is_done(chip)
            chip.field_at = None
        chip.field_gauss = list(FIELD_GAUSS)
        assert measured(clock, chip) != AFTER_SET


@pytest.mark.parametrize(("command", "odd"), [(0x21, 4), (0x01, 0), (0x25, 0)])
def test_exactly_0x21_spoils_x_of_every_16th_sample(clock: Clock, command: int, odd: int) -> None:
    """By 10 to 12 uT. With another bit set (0x25: the interrupt) it does not occur."""
    chip = made(clock)
    samples = [measured(clock, chip, command & ~MEASURE) for _ in range(64)]
    wrong = [number for number, sample in enumerate(samples) if sample != AFTER_SET]
    assert len(wrong) == odd
    for number in wrong:
        assert number % 16 == 15
        assert 0.10 <= samples[number][0] - AFTER_SET[0] <= 0.12  # gauss
        assert samples[number][1:] == AFTER_SET[1:]


@pytest.mark.parametrize(("bandwidth", "noise_mg"), list(enumerate((0.4, 0.6, 0.8, 1.2))))
def test_noise_follows_the_bandwidth(clock: Clock, bandwidth: int, noise_mg: float) -> None:
    chip = made(clock, (0.0, 0.0, 0.0), bandwidth, has_own_noise=True)
    noise = [each for _ in range(700) for each in measured(clock, chip)]
    assert statistics.pstdev(noise) == pytest.approx(noise_mg * 1e-3, rel=0.06)


@pytest.mark.parametrize(("bits", "way"), [(0x00, 0), (0x02, 1), (0x04, -1)])
def test_film_senses_the_coils_field_like_any_other(clock: Clock, bits: int, way: int) -> None:
    chip = made(clock, (0.0, 0.0, 0.0), coil_gauss=(0.125, -0.0625, 0.1875))
    chip.write(bytes((CONTROL_3, bits)))
    for bit, sense in ((SET, 1), (RESET, -1)):
        pulse(clock, chip, bit)
        assert measured(clock, chip) == [sense * way * each for each in chip.coil_gauss]


@pytest.mark.parametrize(("bits", "kept"), [(0x04, (0,)), (0x18, (1, 2)), (0x08, ()), (0x10, ())])
def test_inhibited_axes_keep_their_old_output(clock: Clock, bits: int, kept: tuple[int, ...]) -> None:
    chip = made(clock)
    measured(clock, chip)
    chip.write(bytes((CONTROL_1, 0x02 | bits)))
    chip.feel((0.5, 0.5, -0.5))
    assert measured(clock, chip) == [AFTER_SET[axis] if axis in kept else 0.5 for axis in range(3)]


# -- continuous mode: page 16 --


def per_second(clock: Clock, *controls: int) -> int:
    chip = Mmc5983ma(clock)
    chip.write(bytes((CONTROL_0, *controls)))
    clock.sleep(1.0001)
    is_done(chip)
    return chip.conversions


@pytest.mark.parametrize(("control_2", "samples"), [(0x08, 0), (0x05, 0), (0x0D, 100), (0x0C, 50), (0x0A, 10)])
def test_continuous_mode_needs_a_rate_and_its_bit(clock: Clock, control_2: int, samples: int) -> None:
    assert per_second(clock, 0x00, 0x00, control_2) == samples


@pytest.mark.parametrize(("bandwidth", "limit_hz"), list(enumerate((50, 100, 225, 580))))
def test_continuous_automatic_set_reset_keeps_to_page_2(clock: Clock, bandwidth: int, limit_hz: int) -> None:
    rates = [per_second(clock, AUTOMATIC, bandwidth, 0x88 | code) for code in range(1, 8)]
    assert max(rates) <= limit_hz
    assert max(rates) >= 0.85 * limit_hz
    plain = [per_second(clock, 0x00, bandwidth, 0x08 | code) for code in range(1, 8)]
    assert all(rate * MILLISECONDS[bandwidth] <= 1000 for rate in plain)


def test_continuous_rates_double_without_automatic_set_reset(clock: Clock) -> None:
    for bandwidth, code, rate_hz in ((0, 5, 100), (1, 6, 200), (3, 7, 1000)):
        assert per_second(clock, 0x00, bandwidth, 0x08 | code) == rate_hz
        assert per_second(clock, AUTOMATIC, bandwidth, 0x08 | code) == rate_hz / 2
