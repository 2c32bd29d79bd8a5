"""The MLX90393 three-axis Hall sensor: facts and commands (Melexis data sheet 3901090393 rev. 006).

Every command is answered by a status byte. Four addresses by two pins, so a pad of four needs no mux.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from struct import Struct

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Axes, Chip, Thermometer
from fmfts.sensor.chips.driver import Setup, Wires, saturating, transfer_bits

# Section 15.1: commands; the lower four bits name z, y, x and temperature.
ALL = 0x0F
NOTHING, BURST, SINGLE, READ, READ_REGISTER, WRITE_REGISTER, EXIT = 0x00, 0x10, 0x30, 0x40, 0x50, 0x60, 0x80
STATUS_BURST, STATUS_ERROR = 0x80, 0x10  # section 15.2
EXIT_S = 1e-3  # section 15.1.3: a measurement that is running ends first

# Section 16.1. HALLCONF 0xC is the default; 0x0 is faster and forbids more of the filters below.
HALL_CONFIGURATION = 0x0C
ANALOG = 0x007F  # bits of register 0: GAIN_SEL in 6–4, HALLCONF in 3–0; the others are the factory's
INTERRUPT_PIN, BURST_OF_ALL = 0x8000, ALL << 6  # values of register 1; a burst rate of 0: without a pause
# Of register 2. OSR2 0, OSR 0, DIG_FILT in bits 4–2, RES_Z, RES_Y and RES_X in 10–5. RES picks 16 of 19 bits. With RES
# 0 and 1 a field beyond the range wraps around, and reads as another field; with RES 2 the converter's own end (±22000
# counts) is reached first, so that it can be detected (section 16.2.6). OSR 0: T = 67 + 64 2^OSR (2 + 2^DIG_FILT) µs an
# axis; it is the shortest of the pairs that average equally many samples.
RESOLUTION = 2
RESOLUTIONS = RESOLUTION << 9 | RESOLUTION << 7 | RESOLUTION << 5
FINEST_GAIN_SEL = 7

_ZERO = 0x8000  # of RES 2 (section 16.2.6)
_MEASUREMENT = Struct(">HHHH")  # temperature, x, y, z
_READ_ALL = bytes((READ | ALL,))
# DIG_FILT of each of `output_rates_hz`. DIG_FILT 0 and 1 are not permitted with OSR 0 and HALLCONF 0xC (table 18).
_FILTERS = (7, 6, 5, 4, 3, 2)
_SINGLE_FILTER = 3


class _Registers:
    """The chip's commands for `Driver`, in place of registers."""

    sample_bits = transfer_bits(1, 9)
    trigger_bits = transfer_bits(1)
    trigger = bytes((SINGLE | ALL,))
    stale_samples = 1

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        """It has no identification: the status after a command, and register 0, which holds HALLCONF."""
        wires.exchange(bytes((EXIT,)), 1)
        time.sleep(EXIT_S)
        return _register(wires, 0)

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        """Its registers cannot be read in a burst: it ends the burst first, and begins it last."""
        wires.exchange(bytes((EXIT,)), 1)
        time.sleep(EXIT_S)
        analog = int.from_bytes(_register(wires, 0)[1:], "big") & ~ANALOG
        for number, value in enumerate(_configuration(chip, setup, analog)):
            wires.exchange(bytes((WRITE_REGISTER, value >> 8, value & 0xFF, number << 2)), 1)
        if not self._holds(wires, chip, setup):
            return False
        # The status of the first measurement after a reset must be read back (Melexis rev. 002, page 16). `trigger`
        # cannot do that, so a first single measurement is begun here; `stale_samples` leaves it out.
        status = wires.exchange(bytes(((SINGLE if setup.single else BURST) | ALL,)), 1)
        return not status[0] & STATUS_ERROR if setup.single else _is_in_burst(status)

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        """In a burst only the status can be read: a chip that was reset is not in one."""
        if setup.single:
            return self._holds(wires, chip, setup)
        status = wires.exchange(bytes((NOTHING,)), 1)
        return _is_in_burst(status)

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        """A measurement is handed out once; until the next one the chip answers with an error."""
        answer = wires.exchange(_READ_ALL, 9)
        return (False, None) if answer[0] & STATUS_ERROR else (True, answer[1:])

    def axes(self, chip: Chip, block: bytes) -> Axes:
        _, x, y, z = _MEASUREMENT.unpack(block)
        return saturating(chip, (x - _ZERO, y - _ZERO, z - _ZERO))

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        """46244 at 25 °C, which the wire's 16 signed bits hold less 65536."""
        return int.from_bytes(block[:2], "big", signed=True) if block else None

    def _holds(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        held = [int.from_bytes(_register(wires, number)[1:], "big") for number in range(3)]
        return tuple(held) == _configuration(chip, setup, held[0] & ~ANALOG)


def _register(wires: Wires, number: int) -> bytes:
    """Status, and two bytes."""
    return wires.exchange(bytes((READ_REGISTER, number << 2)), 3)


def _words(wires: Wires) -> Iterator[tuple[int, bytes]]:
    """The customer's 32 words, which can be read only outside a burst."""
    wires.exchange(bytes((EXIT,)), 1)
    time.sleep(EXIT_S)
    for number in range(32):
        yield number, _register(wires, number)[1:]


def _is_in_burst(status: bytes) -> bool:
    return status[0] & (STATUS_BURST | STATUS_ERROR) == STATUS_BURST


# Table 17, HALLCONF 0xC, RES 0: microtesla of a count in x and y, and in z, by GAIN_SEL from 7 down to 2.
_UT_PER_COUNT = ((0.150, 0.242), (0.200, 0.323), (0.250, 0.403), (0.300, 0.484), (0.376, 0.605), (0.451, 0.726))
_LARGEST = 22000


def _conversion_s(filtered: int) -> float:
    """The time of three axes, 67 + 64 (2 + 2^DIG_FILT) µs each, with 0.49 ms (table 18), and 0.26 ms of the
    temperature.
    """
    return (3 * (67 + 64 * (2 + (1 << filtered))) + 490 + 259) * 1e-6


def _per_gauss(microtesla: float) -> float:
    return 100.0 / (microtesla * (1 << RESOLUTION))


MLX90393 = Chip(
    name="mlx90393",
    label="MLX90393",
    driver=_Registers(),
    address=0x0C,
    # Pins A0 and A1 choose one of four. The order code chooses the first: ABA-011 0x0C, 012 0x10, 013 0x14, 014 0x18,
    # and 0x10 of SLQ-ABA-011 and ABA-111 (RT-Thread's driver; the data sheet's ordering table could not be read).
    other_addresses=tuple(range(0x0D, 0x1C)),
    identity=b"\x00\x00\x0c",  # status without mode and error; HALLCONF
    identity_mask=b"\xf0\x00\x0f",
    ranges_gauss=(132.0, 176.0, 220.0, 264.0, 331.0, 397.0),  # of x and y; z: 1.6 times as much
    counts_per_gauss=tuple((_per_gauss(xy), _per_gauss(xy), _per_gauss(z)) for xy, z in _UT_PER_COUNT),
    largest_count=_LARGEST - 1,
    saturated_count=-32768,
    output_rates_hz=tuple(float(int(1.0 / _conversion_s(each))) for each in _FILTERS),
    free_rate_hz=475,
    single_rate_hz=250,
    single_conversion_s=_conversion_s(_SINGLE_FILTER),
    single_wait_s=1.3 * _conversion_s(_SINGLE_FILTER),  # reads at 1.0 fail on real parts (Adafruit issues 17, 18)
    clock_tolerance=0.05,
    noise_t=15e-3 * TESLA_PER_GAUSS,
    # About 10 mG at 10 ms, with the square root of the time of conversion (the data sheet has a graph only).
    noises_t=tuple(mg * 1e-3 * TESLA_PER_GAUSS for mg in (6.2, 8.5, 11.5, 15.0, 18.6, 21.8)),
    single_noise_t=18.6e-3 * TESLA_PER_GAUSS,
    sensitivity_per_k=-0.0003,
    thermometer=Thermometer(at_zero_c=25.0 + (65536 - 46244) / 45.2, c_per_count=1 / 45.2, range_c=(-40.0, 85.0)),
    bias_strap=None,
    board_rates_hz=tuple(float(int(1.0 / _conversion_s(each))) for each in _FILTERS[:4]),
    board_single_hz=155,
    dump=lambda wires: _words(wires),
    asked_by_command=True,
    supply="made; boards 10 to 20 € each, and on every ReSkin, AnySkin and eFlesh board",
    remarks="four addresses by its pins, so no mux for a pad of four; noise from a graph (unverified)",
)


# On a ReSkin, AnySkin or eFlesh board. Its firmware multiplies counts by 0.150 µT (x, y) or 0.242 µT (z), by the gain
# of GAIN_SEL 7 to 0 and by 2^RES (tesshellebrekers/arduino-MLX90393, convertRaw; begin() sets GAIN_SEL 6, RES 0). The
# builder of a board may choose other settings: the steps of eFlesh's boards are 2.4/3.872 and 0.6/0.968 µT.
_BOARD_UT, _BOARD_GAINS = (0.150, 0.242), (1.0, 4 / 3, 5 / 3, 2.0, 2.5, 3.0, 4.0, 5.0)
# By RES the largest count. With RES 0 and 1 a field beyond it wraps around; RES 2 and 3 end earlier (rev 002, table 4).
_BOARD_LARGEST = (32767, 32767, _LARGEST - 1, _LARGEST // 2 - 1)
# Gain × 2^RES → the largest count that any pair of settings with this product has.
_FACTORS = {gain * 2**res: largest for res, largest in reversed([*enumerate(_BOARD_LARGEST)]) for gain in _BOARD_GAINS}
# By gain code of the streamed chip. Code 0 has the steps of the data sheet's rev 002 (GAIN_SEL 7, RES 0). Older
# recordings have no other code.
_STREAMED_UT = ((0.161, 0.294), *((_BOARD_UT[0] * each, _BOARD_UT[1] * each) for each in _FACTORS))
STREAMED_LARGEST = (32767, *_FACTORS.values())
# The code for other steps: 0.6/0.968 µT is less than the chip's noise, and reaches 19 mT.
STREAMED_UNKNOWN = 1 + [*_FACTORS].index(4.0)

ANYSKIN = replace(
    MLX90393,
    name="mlx90393_streamed",
    label="MLX90393 of an AnySkin board",
    ranges_gauss=(
        52.0,
        *(
            round(ut * largest / 100, 1)
            for (ut, _), largest in zip(_STREAMED_UT[1:], STREAMED_LARGEST[1:], strict=True)
        ),
    ),
    counts_per_gauss=tuple((100 / xy, 100 / xy, 100 / z) for xy, z in _STREAMED_UT),
    largest_count=32767,
    output_rates_hz=(500.0,),  # the board's own rate
    free_rate_hz=500,
    single_rate_hz=0,
    board_rates_hz=(),
    dump=None,
    noise_t=20e-3 * TESLA_PER_GAUSS,
    noises_t=(),
    single_noise_t=None,
    streamed=True,
    supply="boards of labs",
    remarks="read by the board's own firmware; its settings are learnt from its values",
)


def _configuration(chip: Chip, setup: Setup, analog: int) -> tuple[int, int, int]:
    """The wanted content of registers 0 to 2. analog: the factory's content of register 0."""
    speed = chip.output_rates_hz.index(chip.output_rate_hz(setup.rate_hz))
    filtered = _SINGLE_FILTER if setup.single else _FILTERS[speed]
    gain = FINEST_GAIN_SEL - setup.gain_code
    return analog | gain << 4 | HALL_CONFIGURATION, INTERRUPT_PIN | BURST_OF_ALL, RESOLUTIONS | filtered << 2
