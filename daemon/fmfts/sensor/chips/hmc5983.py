"""The HMC5983 three-axis magnetometer and its predecessor HMC5883L: facts and registers (Honeywell data sheet 900425).

The predecessor measures at most 75 times a second and has neither temperature compensation nor thermometer. Boards do
not read it.
"""

from __future__ import annotations

from dataclasses import replace
from struct import Struct

from fmfts.sensor.chips.chip import Axes, BiasStrap, Chip, Thermometer
from fmfts.sensor.chips.driver import IDENTITY_BYTES, Setup, Wires, registers, transfer_bits

CONFIG_A, CONFIG_B, MODE, DATA, STATUS, IDENTIFICATION, TEMPERATURE = 0x00, 0x01, 0x02, 0x03, 0x09, 0x0A, 0x31
STATUS_READY = 0x01
MODE_CONTINUOUS, MODE_SINGLE = 0x00, 0x01
TEMPERATURE_COMPENSATION = 0x80  # off at power-on
AVERAGE_8 = 0x60
BIAS_NONE, BIAS_POSITIVE, BIAS_NEGATIVE = 0x00, 0x01, 0x02
IDLE_RATE_HZ = 15  # rate for single measurements, which ignore it; from the data sheet's example of a self-test
STRAP_GAIN_CODE = 5

_TO_STATUS, _TO_DATA = bytes((STATUS,)), bytes((DATA,))
_AXES = Struct(">hhh")


class _Registers:
    """The registers of both chips, as `Driver` has it."""

    sample_bits = transfer_bits(1, 1) + transfer_bits(1, 6)  # status, then data
    trigger_bits = transfer_bits(2)
    trigger = bytes((MODE, MODE_SINGLE))
    stale_samples = 1  # the first sample after a change of gain still has the old gain

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        return wires.exchange(bytes((IDENTIFICATION,)), IDENTITY_BYTES)

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        wires.write(bytes((CONFIG_A,)) + _configuration(chip, setup))
        if not self.is_set_up(wires, chip, setup):
            return False
        if not setup.single:
            wires.write(bytes((MODE, MODE_CONTINUOUS)))
        return True

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        return wires.exchange(bytes((CONFIG_A,)), 2) == _configuration(chip, setup)

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        status = wires.exchange(_TO_STATUS, 1)
        return bool(status[0] & STATUS_READY), wires.exchange(_TO_DATA, 6)

    def axes(self, chip: Chip, block: bytes) -> Axes:
        return axes_from_registers(block)

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        raw = wires.exchange(bytes((TEMPERATURE,)), 2)
        return int.from_bytes(raw, "big", signed=True)


HMC5983 = Chip(
    name="hmc5983",
    label="HMC5983",
    driver=_Registers(),
    address=0x1E,
    identity=b"H43",
    # By gain code (CRB bits 7–5), both from the gain table; the range is the recommended one, a fifth smaller than that
    # of the 12-bit converter.
    ranges_gauss=(0.88, 1.3, 1.9, 2.5, 4.0, 4.7, 5.6, 8.1),
    counts_per_gauss=tuple((counts, counts, counts) for counts in (1370, 1090, 820, 660, 440, 390, 330, 230)),
    largest_count=2047,
    saturated_count=-4096,
    output_rates_hz=(0.75, 1.5, 3.0, 7.5, 15.0, 30.0, 75.0, 220.0),  # CRA bits 4–2
    free_rate_hz=220,
    single_rate_hz=160,
    single_conversion_s=6e-3,
    single_wait_s=6.2e-3,
    clock_tolerance=0.03,
    noise_t=2e-7,  # 2 mG at ±0.88 G
    sensitivity_per_k=-0.0003,  # compensated
    thermometer=Thermometer(at_zero_c=25.0, c_per_count=1 / 128, range_c=(-30.0, 85.0)),  # its "operating temperature"
    bias_strap=BiasStrap(
        gain_code=STRAP_GAIN_CODE,
        limits=(243, 575),
        field_gauss=(1.16, 1.16, 1.08),
        deviation=0.005,
        settings=lambda chip: _strap_settings(chip),
    ),
    board_rates_hz=(220.0,),
    board_single_hz=152,
    # Reading the mode locks the output until all six data registers were read: one transfer does both.
    dump=registers((0x00, 9), (0x09, 1), (0x0A, 3), (0x31, 2)),
    supply="no longer made; boards sold under its name often carry a QMC5883L (older ones) or a QMC5883P (today)",
)
HMC5883L = replace(
    HMC5983,
    name="hmc5883l",
    label="HMC5883L",
    free_rate_hz=75,
    # Firmware cannot distinguish it from an HMC5983, and writes that chip's bits for 220 Hz and compensation, which are
    # reserved here.
    board_rates_hz=(),
    sensitivity_per_k=-0.003,
    thermometer=None,
    dump=registers((0x00, 9), (0x09, 1), (0x0A, 3)),
)

ADDRESS = HMC5983.address


def _configuration(chip: Chip, setup: Setup) -> bytes:
    """The wanted content of configuration registers A and B."""
    return bytes((config_a(chip, IDLE_RATE_HZ if setup.single else setup.rate_hz), config_b(setup.gain_code)))


def config_a(chip: Chip, rate_hz: float, bias: int = 0, averaging: int = 0) -> int:
    """Configuration register A. The chip compensates for temperature if it has a thermometer."""
    compensation = 0 if chip.thermometer is None else TEMPERATURE_COMPENSATION
    return compensation | averaging | chip.output_rates_hz.index(chip.output_rate_hz(rate_hz)) << 2 | bias


def config_b(gain_code: int) -> int:
    return gain_code << 5


def _strap_settings(chip: Chip) -> tuple[bytes, bytes, bytes]:
    """Registers A and B without bias, with the positive and with the negative one."""
    none, positive, negative = (
        bytes((CONFIG_A, config_a(chip, IDLE_RATE_HZ, bias, AVERAGE_8), config_b(STRAP_GAIN_CODE)))
        for bias in (BIAS_NONE, BIAS_POSITIVE, BIAS_NEGATIVE)
    )
    return none, positive, negative


def axes_from_registers(block: bytes) -> Axes:
    """Counts (x, y, z) of the six data registers: big-endian, in the chip's order X, Z, Y."""
    x, z, y = _AXES.unpack(block)
    return x, y, z
