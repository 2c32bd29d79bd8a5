"""How many readings a second chip, board and bus allow: one definition for config checks, bridge and reader."""

from __future__ import annotations

from fmfts.sensor.chips.chip import Chip

BRIDGE_HZ = 220  # docs/wire.md, host → board: the most that the firmware accepts of any chip
# On I2C. Select: START, address, control byte, STOP; then the chip's own transfer.
BITS_PER_SELECTION = 20
BITS_PER_PAD = 20  # the mux's control byte read back


def highest_rate_hz(chip: Chip, trigger: str, *, over_bridge: bool) -> int:
    """What the chips allow, and the board that reads them; an I2C bus has a limit of its own, `i2c_rate_hz`."""
    chip_hz = chip.highest_rate_hz(trigger)
    if not over_bridge:
        return chip_hz
    return min(chip_hz, BRIDGE_HZ, chip.board_single_hz if trigger == "simultaneous" else BRIDGE_HZ)


def fastest_on_board_hz(chip: Chip, rate_hz: int) -> float:
    """How many samples a second a chip may give that runs free for frames at `rate_hz`: its clock is off by its
    tolerance."""
    rates = (*(rate for rate in chip.board_rates_hz if rate >= rate_hz), chip.board_rates_hz[-1])
    return min(rates) * (1.0 + chip.clock_tolerance)


def i2c_cycle_s(chip: Chip, clock_hz: int, sensors: int, pads: int, trigger: str, *, muxed: bool = True) -> float:
    """Time on the wires for one reading of all sensors of a bus."""
    bits = sensors * chip.driver.sample_bits
    if muxed:
        bits += sensors * BITS_PER_SELECTION + pads * BITS_PER_PAD
    if trigger == "simultaneous":  # with a mux one write reaches all sensors of a pad
        bits += pads * (BITS_PER_SELECTION + chip.driver.trigger_bits) if muxed else sensors * chip.driver.trigger_bits
    return bits / clock_hz


def i2c_rate_hz(chip: Chip, trigger: str, clock_hz: int, sensors: int, pads: int, *, muxed: bool = True) -> int:
    """What chips and bus allow together: simultaneous conversions have to end before they can be read."""
    waiting_s = chip.single_wait_s if trigger == "simultaneous" else 0.0
    bus_hz = int(1.0 / (waiting_s + i2c_cycle_s(chip, clock_hz, sensors, pads, trigger, muxed=muxed)))
    return min(chip.highest_rate_hz(trigger), bus_hz)


def no_trigger(chip: Chip) -> str:
    """The sentence for a chip that is asked for simultaneous measurements, and takes no such word."""
    return f'an {chip.label} measures at its own times only: set trigger = "free"'
