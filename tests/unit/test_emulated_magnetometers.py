"""The emulated QMC5883L and LIS3MDL against their data sheets, register by register, without any driver.

The reset values and read-only registers of the others, too; test_emulated_mmc5983ma.py, test_emulated_mmc5603nj.py and
test_emulated_qmc5883p.py have the rest of them.

The data sheets could not be read here: these facts are common to public drivers (lab/results/chip-facts.md).
"""

from __future__ import annotations

from typing import Any

import pytest
from emulated_bus import Clock, read

from emulator.magnetometers import Lis3mdl, Mmc5603nj, Mmc5983ma, Qmc5883l, Qmc5883p

FIELD_GAUSS = (0.75, -1.5, 0.3)
ADVANCE = 0x80  # bit of a LIS3MDL's register number


@pytest.fixture
def clock() -> Clock:
    return Clock()


def signed(data: bytes) -> list[int]:
    return [int.from_bytes(data[at : at + 2], "little", signed=True) for at in range(0, len(data), 2)]


# The chips' state after a reset, and what cannot be written: chip, register, value.
RESET_VALUES = [
    (Qmc5883l, 0x0D, 0xFF),
    (Qmc5883l, 0x06, 0x00),
    (Qmc5883l, 0x09, 0x00),
    (Lis3mdl, 0x0F, 0x3D),
    (Lis3mdl, 0x20, 0x10),
    (Lis3mdl, 0x21, 0x00),
    (Lis3mdl, 0x22, 0x03),
    (Lis3mdl, 0x24, 0x00),
    (Mmc5983ma, 0x08, 0x10),
    (Mmc5983ma, 0x2F, 0x30),
    (Mmc5603nj, 0x18, 0x10),
    (Mmc5603nj, 0x39, 0x10),
    (Qmc5883p, 0x00, 0x80),
    (Qmc5883p, 0x09, 0x00),
    (Qmc5883p, 0x0A, 0x00),
    (Qmc5883p, 0x0B, 0x00),
]
READ_ONLY = [
    (Qmc5883l, (0x00, 0x05, 0x06, 0x0D)),
    (Lis3mdl, (0x0F, 0x27, 0x28, 0x2D, 0x2F)),
    (Mmc5983ma, (0x00, 0x06, 0x2F)),
    (Mmc5603nj, (0x00, 0x08, 0x18, 0x39)),
    (Qmc5883p, (0x00, 0x01, 0x06, 0x09)),
]
SOFT_RESET = {
    Qmc5883l: (0x0A, 0x80),
    Lis3mdl: (0x21, 0x04),
    Mmc5983ma: (0x0A, 0x80),
    Mmc5603nj: (0x1C, 0x80),
    Qmc5883p: (0x0B, 0x80),
}
SETTINGS = {Qmc5883l: 0x09, Lis3mdl: ADVANCE | 0x20, Qmc5883p: 0x0A}  # the first register that holds one


@pytest.mark.parametrize(("kind", "register", "value"), RESET_VALUES)
def test_registers_after_power_and_after_a_reset(clock: Clock, kind: Any, register: int, value: int) -> None:
    chip = kind(clock)
    read(chip, 0x00)
    assert read(chip, register) == bytes((value,))
    if kind in SETTINGS:
        chip.write(bytes((SETTINGS[kind], 0x1D, 0x40, 0x00, 0x00, 0x40)))
    chip.write(bytes(SOFT_RESET[kind]))
    assert read(chip, register) == bytes((value,))


@pytest.mark.parametrize(("kind", "registers"), READ_ONLY)
def test_outputs_and_names_cannot_be_written(clock: Clock, kind: Any, registers: tuple[int, ...]) -> None:
    chip = kind(clock)
    before = [read(chip, register) for register in registers]
    for register in registers:
        chip.write(bytes((register, 0xA5)))
    assert [read(chip, register) for register in registers] == before


# -- QMC5883L --


def qmc(clock: Clock, control_1: int, **options: Any) -> Qmc5883l:
    chip = Qmc5883l(clock, options.pop("field_gauss", FIELD_GAUSS), **options)
    chip.write(bytes((0x09, control_1)))
    return chip


@pytest.mark.parametrize(("range_bit", "counts"), [(0x00, [9000, -18000, 3600]), (0x10, [2250, -4500, 900])])
def test_qmc_gives_low_bytes_first_in_steps_of_its_range(clock: Clock, range_bit: int, counts: list[int]) -> None:
    chip = qmc(clock, range_bit | 0x0D)
    clock.sleep(0.0051)
    assert signed(read(chip, 0x00, 6)) == counts


@pytest.mark.parametrize(("code", "rate_hz"), list(enumerate((10, 50, 100, 200))))
def test_qmc_is_ready_at_its_rate_until_an_output_is_read(clock: Clock, code: int, rate_hz: int) -> None:
    chip = qmc(clock, code << 2 | 1)
    clock.sleep(0.99 / rate_hz)
    assert read(chip, 0x06)[0] & 1 == 0
    clock.sleep(0.02 / rate_hz)
    assert read(chip, 0x06)[0] & 1 == 1
    assert read(chip, 0x06)[0] & 1 == 1  # reading the status does not clear it
    read(chip, 0x03)
    assert read(chip, 0x06)[0] & 1 == 0
    clock.sleep(2.5 / rate_hz)
    assert read(chip, 0x06)[0] & 5 == 5  # a sample was skipped: DOR
    chip.write(b"\x09\x00")  # standby
    read(chip, 0x00)
    clock.sleep(3.0 / rate_hz)
    assert read(chip, 0x06)[0] & 5 == 0


def test_qmc_reports_one_overflow_for_all_axes(clock: Clock) -> None:
    chip = qmc(clock, 0x0D, field_gauss=(0.1, -2.8, 0.1))
    clock.sleep(0.0051)
    assert read(chip, 0x06)[0] & 2 == 2
    assert signed(read(chip, 0x00, 6)) == [1200, -32768, 1200]
    assert read(chip, 0x06)[0] & 3 == 2
    chip.feel((0.1, 2.7, 0.1))
    clock.sleep(0.0051)
    assert read(chip, 0x06)[0] & 2 == 0


def test_qmc_rolls_over_from_its_status_only_if_told(clock: Clock) -> None:
    for roll, following in ((0x40, b"\x28"), (0x00, b"\x00")):  # 9000 is 0x2328; the thermometer stands at zero
        chip = qmc(clock, 0x0D)
        chip.write(bytes((0x0A, roll)))
        clock.sleep(0.0051)
        assert read(chip, 0x06, 2)[1:] == following


def test_qmc_identity_is_zero_until_register_0_was_read(clock: Clock) -> None:
    """PX4 and ArduPilot read register 0x00 before they ask for the identity."""
    chip = Qmc5883l(clock)
    assert read(chip, 0x0A, 4)[3] == 0x00
    assert read(chip, 0x0D) == b"\x00"
    read(chip, 0x00)
    assert read(chip, 0x0D) == b"\xff"
    chip.write(b"\x0a\x80")
    assert read(chip, 0x0D) == b"\xff"
    chip.power_on()
    assert read(chip, 0x0D) == b"\x00"


def test_qmc_takes_commands_of_an_mlx90393_as_register_numbers(clock: Clock) -> None:
    """An MLX90393 may have the same address: 0x80 (exit) moves the pointer, 0x50 0x00 writes register 0x50."""
    chip = qmc(clock, 0x0D)
    clock.sleep(0.0051)
    chip.write(b"\x80")
    assert chip.pointer == 0x80
    assert chip.read(1) == b"\x00"
    chip.write(b"\x50\x00")
    assert chip.pointer == 0x51
    assert chip.read(3) == b"\x00\x00\x00"
    assert signed(read(chip, 0x00, 6)) == [9000, -18000, 3600]  # it measures as before
    assert read(chip, 0x09) == b"\x0d"


# -- LIS3MDL --


def lis(clock: Clock, *controls: int, field_gauss: tuple[float, ...] = FIELD_GAUSS) -> Lis3mdl:
    chip = Lis3mdl(clock, field_gauss)
    chip.write(bytes((ADVANCE | 0x20, *controls)))
    return chip


@pytest.mark.parametrize(("code", "lsb"), list(enumerate((6842, 3421, 2281, 1711))))
def test_lis_gives_low_bytes_first_and_clips(clock: Clock, code: int, lsb: int) -> None:
    chip = lis(clock, 0x1C, code << 5, 0x00, field_gauss=(0.75, -1.5, 40.0))
    clock.sleep(0.0126)
    x, y, z = signed(read(chip, ADVANCE | 0x28, 6))
    assert (x, y, z) == (round(0.75 * lsb), round(-1.5 * lsb), 32767)


@pytest.mark.parametrize(("performance", "rate_hz"), list(enumerate((1000, 560, 300, 155))))
def test_lis_is_as_fast_as_its_performance_allows(clock: Clock, performance: int, rate_hz: int) -> None:
    chip = lis(clock, performance << 5 | 0x02, 0x00, 0x00)
    clock.sleep(0.99 / rate_hz)
    assert read(chip, 0x27) == b"\x00"
    clock.sleep(0.02 / rate_hz)
    assert read(chip, 0x27) == b"\x0f"
    read(chip, ADVANCE | 0x28, 5)
    assert read(chip, 0x27) == b"\x0f"  # one byte is unread
    read(chip, 0x2D)
    assert read(chip, 0x27) == b"\x00"
    clock.sleep(2.5 / rate_hz)
    assert read(chip, 0x27) == b"\xff"  # overrun


def test_lis_advances_only_with_the_top_bit_and_repeats_its_axes(clock: Clock) -> None:
    chip = lis(clock, 0x9C, 0x00, 0x00)
    clock.sleep(0.0126)
    low, high = read(chip, ADVANCE | 0x28, 2)
    assert low != high
    assert read(chip, 0x28, 3) == bytes((low, low, low))
    assert read(chip, ADVANCE | 0x2C, 4)[2:] == bytes((low, high))  # not the temperature


def test_lis_single_measurement_ends_in_power_down(clock: Clock) -> None:
    chip = lis(clock, 0x70, 0x00, 0x01)
    clock.sleep(0.0063)
    assert read(chip, 0x22) == b"\x01"
    clock.sleep(0.0002)
    assert read(chip, 0x27) == b"\x0f"
    assert read(chip, 0x22) == b"\x03"
    read(chip, ADVANCE | 0x28, 6)
    clock.sleep(1.0)
    assert read(chip, 0x27) == b"\x00"


@pytest.mark.parametrize(("thermometer", "counts"), [(0x80, 8 * 16), (0x00, 0)])
def test_lis_thermometer_counts_eighths_from_25(clock: Clock, thermometer: int, counts: int) -> None:
    chip = lis(clock, thermometer | 0x1C, 0x00, 0x00)
    chip.temperature_c = 41.0
    clock.sleep(0.0126)
    assert signed(read(chip, ADVANCE | 0x2E, 2)) == [counts]


def test_lis_self_test_field_settles_and_ends_with_its_bit(clock: Clock) -> None:
    chip = lis(clock, 0x1D, 0x40, 0x00, field_gauss=(0.0, 0.0, 0.0))
    clock.sleep(0.0126)
    early = signed(read(chip, ADVANCE | 0x28, 6))[0]
    clock.sleep(0.0625)
    assert 0 < early < signed(read(chip, ADVANCE | 0x28, 6))[0] == 2 * 2281
    chip.write(b"\x20\x1c")
    clock.sleep(0.0126)
    assert signed(read(chip, ADVANCE | 0x28, 6)) == [0, 0, 0]
