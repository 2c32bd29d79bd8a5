"""The QMC5883L three-axis magnetometer: facts and registers (QST data sheet 13-52-04, rev. 1.0).

Older boards sold as HMC5883L carry it; boards sold today carry the QMC5883P. Registers, address and scale are its own.
"""

from __future__ import annotations

from struct import Struct

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Axes, Chip
from fmfts.sensor.chips.driver import Setup, Wires, overflowing, registers, transfer_bits

# Section 9.1: X, Y, Z at 0x00 to 0x05, low byte first; after control 2 the period, a reserved one, the identification.
STATUS, CONTROL_1, CONTROL_2 = 0x06, 0x09, 0x0A
STATUS_READY, STATUS_OVERFLOW = 0x01, 0x02
MODE_CONTINUOUS = 0x01  # section 9.2.3: bits 1–0; output rate 3–2; range 5–4; oversampling 7–6, of which 0 is 512
ROLL_OVER, NO_INTERRUPT = 0x40, 0x01  # section 9.2.4
SET_RESET_PERIOD = 0x01  # section 9.2.5: recommended

_AXES = Struct("<hhh")
# With ROLL_OVER the pointer goes from 0x06 to 0x00, so that one transfer brings the status and the sample after it.
_STATUS_AND_AXES = bytes((STATUS,))


class _Registers:
    """The chip's registers for `Driver`."""

    sample_bits = transfer_bits(1, 7)
    trigger_bits = 0
    trigger = b""  # the chip has no single measurements
    stale_samples = 1

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        """Control 2, the period, and the identification 0xFF. An undriven bus reads the same value.

        PX4 and ArduPilot read a register before: the first answer after power-on may be wrong.
        """
        wires.exchange(b"\x00", 1)
        answer = wires.exchange(bytes((CONTROL_2,)), 4)
        return answer[:2] + answer[3:]

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        control, *others = _configuration(chip, setup)
        wires.write(bytes((CONTROL_2, *others)))
        wires.write(bytes((CONTROL_1, control)))  # last: the mode, which begins to measure
        return self.is_set_up(wires, chip, setup)

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        return wires.exchange(bytes((CONTROL_1,)), 3) == _configuration(chip, setup)

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        answer = wires.exchange(_STATUS_AND_AXES, 7)
        status = answer[0]
        if not status & STATUS_READY:  # old, or the zeros of a chip that was reset
            return False, None
        return True, bytes((status & STATUS_OVERFLOW,)) + answer[1:]

    def axes(self, chip: Chip, block: bytes) -> Axes:
        return overflowing(chip, _AXES.unpack(block[1:]), bool(block[0]))

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        return None


QMC5883L = Chip(
    name="qmc5883l",
    label="QMC5883L",
    driver=_Registers(),
    address=0x0D,
    identity=b"\x00\x00\xff",
    identity_mask=b"\x3e\xfe\xff",  # bits that are not used are zero
    ranges_gauss=(2.0, 8.0),
    counts_per_gauss=tuple((counts, counts, counts) for counts in (12000, 3000)),  # section 2.2
    largest_count=32766,  # the count stays at 32767 or −32768 beyond its range
    saturated_count=-32768,
    output_rates_hz=(10.0, 50.0, 100.0, 200.0),
    free_rate_hz=200,
    single_rate_hz=0,
    single_conversion_s=0.0,
    single_wait_s=0.0,
    clock_tolerance=0.05,
    noise_t=2e-3 * TESLA_PER_GAUSS,  # section 2.2, field resolution: at ±2 G, 512 times oversampled
    sensitivity_per_k=-0.0005,
    thermometer=None,  # its thermometer has no known zero (section 9.2.2)
    bias_strap=None,
    board_rates_hz=(200.0,),
    dump=registers((0x00, 6), (0x06, 1), (0x07, 2), (0x09, 5)),  # after 0x06 comes 0x00 (ROLL_OVER)
    supply="made; on older boards sold as HMC5883L, under 5 € each; today's carry a QMC5883P",
)


def _configuration(chip: Chip, setup: Setup) -> bytes:
    """The wanted content of control registers 1 and 2, and of the period of set and reset."""
    rate = chip.output_rates_hz.index(chip.output_rate_hz(setup.rate_hz))
    return bytes((setup.gain_code << 4 | rate << 2 | MODE_CONTINUOUS, ROLL_OVER | NO_INTERRUPT, SET_RESET_PERIOD))
