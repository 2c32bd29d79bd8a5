"""The MMC5983MA three-axis magnetometer: facts and registers (MEMSIC data sheet rev. A)."""

from __future__ import annotations

import time
from struct import Struct

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Axes, Chip, SetReset
from fmfts.sensor.chips.driver import Setup, Wires, registers, saturating

# Register map. The controls cannot be read back; a bit that starts something clears itself.
AXES, STATUS, CONTROL_0, CONTROL_1, CONTROL_3, PRODUCT = 0x00, 0x08, 0x09, 0x0A, 0x0C, 0x2F
STATUS_FIELD_DONE, STATUS_FUSES_READ = 0x01, 0x10
MEASURE_FIELD, SET_PULSE, RESET_PULSE, AUTOMATIC_SET = 0x01, 0x08, 0x10, 0x20  # control 0
RESET = 0x80  # control 1; the bandwidth in bits 1–0
CONTINUOUS, PERIODIC_SET = 0x08, 0x80  # control 2: rate in bits 2–0; bits 6–4 are 0: a set before every measurement
COIL_ONE_WAY, COIL_OTHER_WAY = 0x02, 0x04  # control 3: St_enp, St_enm
RESET_S = 10e-3

# Of each of `output_rates_hz`: its code in control 2, and the bandwidth whose measurement is over in its period:
# 8 ms, 4 ms, 2 ms, 0.5 ms (control 1).
_SPEEDS = ((1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (6, 1), (7, 3))
_SINGLE_BANDWIDTH = 2
_ZERO = 0x8000
_AXES = Struct(">HHH")
_TO_STATUS, _TO_AXES = bytes((STATUS,)), bytes((AXES,))
_CLEAR_DONE = bytes((STATUS, STATUS_FIELD_DONE))

# "Using set and reset to remove bridge offset". The automatic set stays off: it would undo the reset.
_SET_RESET = SetReset(
    stop=bytes((CONTROL_0, 0, _SINGLE_BANDWIDTH, 0)),
    set_pulse=bytes((CONTROL_0, SET_PULSE)),
    reset_pulse=bytes((CONTROL_0, RESET_PULSE)),
    settle_s=(10e-3, 1e-3),  # longer than a measurement of 8 ms that may be under way; the pulse lasts 0.5 µs
    measure=bytes((CONTROL_0, MEASURE_FIELD)),
    status=_TO_STATUS,
    done=STATUS_FIELD_DONE,
    samples=5,
    coil=(bytes((CONTROL_3, COIL_ONE_WAY)), bytes((CONTROL_3, COIL_OTHER_WAY))),
    largest_zero_gauss=0.5,  # null field output (unverified)
    # Nothing that could be read for certain tells the coil's field; a public driver says 80 to 175 mG either way. This
    # is 20 deviations of the noise of two means of five: an axis that shows less does not feel the coil.
    least_coil_gauss=10e-3,
)


class _Registers:
    """As `Driver` has it. A set pulse before each measurement frees the chip of what a strong magnet left in it."""

    sample_bits = 39 + 29 + 84
    trigger_bits = 29
    trigger = bytes((CONTROL_0, AUTOMATIC_SET | MEASURE_FIELD))
    stale_samples = 1

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        product = wires.exchange(bytes((PRODUCT,)), 1)
        return product + b"\x00\x00"

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        wires.write(bytes((CONTROL_1, RESET)))
        time.sleep(RESET_S)
        wires.write(bytes((CONTROL_0,)) + _configuration(chip, setup))
        return self.is_set_up(wires, chip, setup)

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        """As far as it tells: its factory's settings are loaded. After a reset it delivers nothing, which is seen."""
        status = wires.exchange(_TO_STATUS, 1)
        return bool(status[0] & STATUS_FUSES_READ)

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        """The bit "done" stays until it is cleared. A measurement that ends between its reading and its clearing is not
        announced, but its bytes are read; one that ends later is announced, and read again as the same bytes.
        """
        status = wires.exchange(_TO_STATUS, 1)
        wires.write(_CLEAR_DONE)
        block = wires.exchange(_TO_AXES, 6)
        return bool(status[0] & STATUS_FIELD_DONE), block if any(block) else None  # zeros: it was reset

    def axes(self, chip: Chip, block: bytes) -> Axes:
        """The upper 16 of its 18 bits: a step of 0.24 mG beside a noise of 0.4 mG or more."""
        x, y, z = _AXES.unpack(block)
        return saturating(chip, (x - _ZERO, y - _ZERO, z - _ZERO))

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        return None


MMC5983MA = Chip(
    name="mmc5983ma",
    label="MMC5983MA",
    driver=_Registers(),
    address=0x30,
    identity=b"\x30\x00\x00",
    ranges_gauss=(8.0,),
    # 16384 of 18 bits. Its axes are left-handed: z grows into the board, where x and y are as on it. The drivers that
    # fly it (ArduPilot, PX4 of 2024) turn all three over, which is the same but for half a turn about z.
    counts_per_gauss=((4096, 4096, -4096),),
    largest_count=32766,
    saturated_count=-32768,
    output_rates_hz=(1.0, 10.0, 20.0, 50.0, 100.0, 200.0, 1000.0),
    free_rate_hz=1000,
    single_rate_hz=350,
    single_conversion_s=2e-3,
    single_wait_s=2.2e-3,
    clock_tolerance=0.05,
    noise_t=1.2e-3 * TESLA_PER_GAUSS,
    noises_t=tuple(mg * 1e-3 * TESLA_PER_GAUSS for mg in (0.4, 0.4, 0.4, 0.4, 0.4, 0.6, 1.2)),
    single_noise_t=0.8e-3 * TESLA_PER_GAUSS,
    sensitivity_per_k=-0.0002,
    thermometer=None,  # 0.8 °C a step, measured in place of the field; others found that it does not work
    bias_strap=None,
    set_reset=_SET_RESET,
    board_rates_hz=(100.0, 200.0, 1000.0),  # below 100 Hz the noise stays as it is
    board_single_hz=203,
    dump=registers((0x00, 8), (0x08, 1), (0x09, 4), (0x2F, 1)),
    supply="made; boards 10 to 20 € each",
    remarks="one address, so a mux; its thermometer (0.8 °C a step) is not used; its settings cannot be read back; "
    "left-handed, as flight controllers take it: where `baseline --rest` finds it otherwise, it says so",
)


def _configuration(chip: Chip, setup: Setup) -> bytes:
    """The wanted content of controls 0 to 2."""
    if setup.single:
        return bytes((AUTOMATIC_SET, _SINGLE_BANDWIDTH, 0))
    rate, bandwidth = _SPEEDS[chip.output_rates_hz.index(chip.output_rate_hz(setup.rate_hz))]
    return bytes((AUTOMATIC_SET, bandwidth, PERIODIC_SET | CONTINUOUS | rate))
