"""The LIS3MDL three-axis magnetometer: facts and registers (ST data sheet DocID024204 rev. 6, note AN4602)."""

from __future__ import annotations

from struct import Struct

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Axes, Chip, OwnField, Thermometer
from fmfts.sensor.chips.driver import Setup, Wires, registers, saturating, transfer_bits

# Section 6, register mapping. The top bit of a register's number makes it advance (section 5.1.1).
ADVANCE = 0x80
WHO_AM_I, CONTROL_1, CONTROL_3, STATUS, TEMPERATURE = 0x0F, 0x20, 0x22, 0x27, 0x2E
STATUS_READY = 0x08  # ZYXDA: all three axes are new
THERMOMETER_ON, FAST = 0x80, 0x02  # CTRL_REG1; performance in bits 6–5, output rate in 4–2
SELF_TEST = 0x01  # of CTRL_REG1
BLOCK_UPDATE = 0x40  # CTRL_REG5: high and low byte of a sample belong together
MODE_CONTINUOUS, MODE_SINGLE, MODE_OFF = 0x00, 0x01, 0x03  # CTRL_REG3
RATE_80_HZ = 7
LOW_POWER, MEDIUM, HIGH, ULTRA_HIGH = range(4)

# Of each of `output_rates_hz`: bits of CTRL_REG1 but the thermometer, and the performance, which CTRL_REG4 has for z.
_SPEEDS = (
    (ULTRA_HIGH << 5 | RATE_80_HZ << 2, ULTRA_HIGH),
    (ULTRA_HIGH << 5 | FAST, ULTRA_HIGH),
    (HIGH << 5 | FAST, HIGH),
    (MEDIUM << 5 | FAST, MEDIUM),
    (LOW_POWER << 5 | FAST, LOW_POWER),
)
_AXES = Struct("<hhh")
_STATUS_AND_AXES = bytes((ADVANCE | STATUS,))


# AN4602, self-test: ±12 G, 80 Hz, low power; 1 to 3 G are due in x and y, 0.1 to 1 G in z, of 2281 counts a gauss.
_TEST_GAIN_CODE = 2
_TEST_SPEED = LOW_POWER << 5 | RATE_80_HZ << 2
_TEST_REST = bytes((_TEST_GAIN_CODE << 5, MODE_CONTINUOUS, LOW_POWER << 2, BLOCK_UPDATE))


class _Registers:
    """The chip's registers for `Driver`."""

    sample_bits = transfer_bits(1, 7)
    trigger_bits = transfer_bits(2)
    trigger = bytes((CONTROL_3, MODE_SINGLE))
    stale_samples = 1

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        name = wires.exchange(bytes((WHO_AM_I,)), 1)
        return name + b"\x00\x00"

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        wires.write(bytes((ADVANCE | CONTROL_1,)) + _configuration(chip, setup))
        return self.is_set_up(wires, chip, setup)

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        held = wires.exchange(bytes((ADVANCE | CONTROL_1,)), 5)
        wanted = _configuration(chip, setup)
        # A single measurement may be running: then its mode is not "off" yet.
        return held == wanted or (setup.single and held[:2] + held[3:] == wanted[:2] + wanted[3:])

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        answer = wires.exchange(_STATUS_AND_AXES, 7)
        # Not ready: old, or the zeros of a chip that was reset.
        return (True, answer[1:]) if answer[0] & STATUS_READY else (False, None)

    def axes(self, chip: Chip, block: bytes) -> Axes:
        return saturating(chip, _AXES.unpack(block))

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        """A transfer of its own: read on from the axes, these registers repeat the x axis."""
        raw = wires.exchange(bytes((ADVANCE | TEMPERATURE,)), 2)
        return int.from_bytes(raw, "little", signed=True)


LIS3MDL = Chip(
    name="lis3mdl",
    label="LIS3MDL",
    driver=_Registers(),
    address=0x1C,
    other_addresses=(0x1E,),  # by pin SA1; the second address is the HMC5983's, too
    identity=b"\x3d\x00\x00",
    ranges_gauss=(4.0, 8.0, 12.0, 16.0),
    counts_per_gauss=tuple((counts, counts, counts) for counts in (6842, 3421, 2281, 1711)),  # table 3
    largest_count=27366,  # the full scale: counts beyond it are not specified
    saturated_count=-32768,
    output_rates_hz=(80.0, 155.0, 300.0, 560.0, 1000.0),  # table 21
    free_rate_hz=1000,
    single_rate_hz=80,  # table 24: single conversions go with output rates of 80 Hz and less
    single_conversion_s=6.5e-3,
    single_wait_s=7.2e-3,
    clock_tolerance=0.1,
    noise_t=4.6e-3 * TESLA_PER_GAUSS,
    # Ultra-high performance from table 3 (3.2 mG; 4.1 mG in z counts least and is left out); the faster ones from the
    # number of measurements that each averages: in no data sheet.
    noises_t=tuple(mg * 1e-3 * TESLA_PER_GAUSS for mg in (3.2, 3.2, 4.6, 6.1, 8.1)),
    single_noise_t=3.2e-3 * TESLA_PER_GAUSS,
    zero_t=1.0 * TESLA_PER_GAUSS,  # table 3: zero-gauss level, typical
    sensitivity_per_k=-0.0003,
    thermometer=Thermometer(at_zero_c=25.0, c_per_count=1 / 8, range_c=(-40.0, 85.0)),
    bias_strap=None,
    own_field=OwnField(
        gain_code=_TEST_GAIN_CODE,
        limits=((2281, 6843), (2281, 6843), (228, 2281)),
        without=bytes((ADVANCE | CONTROL_1, _TEST_SPEED)) + _TEST_REST,
        with_field=bytes((CONTROL_1, _TEST_SPEED | SELF_TEST)),
        settle_s=(20e-3, 60e-3),
        samples=5,
    ),
    board_rates_hz=(80.0, 155.0, 300.0),
    board_single_hz=80,
    dump=registers((0x05, 6), (0x0F, 1), (0x20, 5), (0x27, 7), (0x2E, 2), (0x30, 4), advance=ADVANCE),
    supply="its maker calls it obsolete; boards with it are still sold, 5 to 10 € each",
    remarks="two addresses, so two chips a bus or a mux's channel; noise above 155 Hz is computed (unverified)",
)


def _configuration(chip: Chip, setup: Setup) -> bytes:
    """The wanted content of CTRL_REG1 to CTRL_REG5."""
    speed = 0 if setup.single else chip.output_rates_hz.index(chip.output_rate_hz(setup.rate_hz))
    first, performance = _SPEEDS[speed]
    mode = MODE_OFF if setup.single else MODE_CONTINUOUS
    return bytes((THERMOMETER_ON | first, setup.gain_code << 5, mode, performance << 2, BLOCK_UPDATE))
