"""The HMC5983 three-axis magnetometer and its predecessor HMC5883L: facts and registers (Honeywell data sheet 900425).

The predecessor measures at most 75 times a second and has neither temperature compensation nor thermometer.
"""

from __future__ import annotations

from dataclasses import replace
from struct import Struct

from fmfts.sensor.chips.chip import Axes, BiasStrap, Chip, Thermometer

HMC5983 = Chip(
    name="hmc5983",
    label="HMC5983",
    address=0x1E,
    identity=b"H43",
    # By gain code (CRB bits 7–5), both from the gain table; the range is the one it recommends, a fifth smaller than
    # what the 12-bit converter can tell.
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
    bias_strap=BiasStrap(gain_code=5, limits=(243, 575), field_gauss=(1.16, 1.16, 1.08), deviation=0.005),
)
HMC5883L = replace(
    HMC5983, name="hmc5883l", label="HMC5883L", free_rate_hz=75, sensitivity_per_k=-0.003, thermometer=None
)

ADDRESS = HMC5983.address
CONFIG_A, CONFIG_B, MODE, DATA, STATUS, IDENTIFICATION, TEMPERATURE = 0x00, 0x01, 0x02, 0x03, 0x09, 0x0A, 0x31
STATUS_READY = 0x01
MODE_CONTINUOUS, MODE_SINGLE = 0x00, 0x01
TEMPERATURE_COMPENSATION = 0x80  # off at power-on
AVERAGE_8 = 0x60
BIAS_NONE, BIAS_POSITIVE, BIAS_NEGATIVE = 0x00, 0x01, 0x02

_AXES = Struct(">hhh")


def config_a(chip: Chip, rate_hz: float, bias: int = 0, averaging: int = 0) -> int:
    """Configuration register A. The chip compensates for temperature if it has a thermometer."""
    compensation = 0 if chip.thermometer is None else TEMPERATURE_COMPENSATION
    return compensation | averaging | chip.output_rates_hz.index(chip.output_rate_hz(rate_hz)) << 2 | bias


def config_b(gain_code: int) -> int:
    return gain_code << 5


def axes_from_registers(block: bytes) -> Axes:
    """Counts (x, y, z) of the six data registers: big-endian, in the chip's order X, Z, Y."""
    x, z, y = _AXES.unpack(block)
    return x, y, z
