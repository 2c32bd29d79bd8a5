"""How many readings a second chip, board and bus allow: one definition for config checks, bridge and reader."""

from __future__ import annotations

from fmfts.sensor.chips.chip import Chip

BRIDGE_SIMULTANEOUS_HZ = 152  # docs/wire.md, host → board: what the firmware accepts
# On I2C. Select: START, address, control byte, STOP; then status and six data bytes in one transfer, repeated starts.
BITS_PER_SENSOR = 20 + 126
BITS_PER_PAD = 20  # the mux's control byte read back
BITS_PER_TRIGGER = 20 + 29  # of a pad: several channels selected, the mode register written


def highest_rate_hz(chip: Chip, trigger: str, *, over_bridge: bool) -> int:
    """What the chips allow, and the board that reads them; an I2C bus has a limit of its own, `i2c_rate_hz`."""
    chip_hz = chip.highest_rate_hz(trigger)
    return min(chip_hz, BRIDGE_SIMULTANEOUS_HZ) if over_bridge and trigger == "simultaneous" else chip_hz


def i2c_cycle_s(clock_hz: int, sensors: int, pads: int, trigger: str) -> float:
    """Time on the wires for one reading of all sensors of a bus."""
    bits = sensors * BITS_PER_SENSOR + pads * BITS_PER_PAD
    return (bits + (pads * BITS_PER_TRIGGER if trigger == "simultaneous" else 0)) / clock_hz


def i2c_rate_hz(chip: Chip, trigger: str, clock_hz: int, sensors: int, pads: int) -> int:
    """What chips and bus allow together: simultaneous conversions have to end before they can be read."""
    waiting_s = chip.single_wait_s if trigger == "simultaneous" else 0.0
    bus_hz = int(1.0 / (waiting_s + i2c_cycle_s(clock_hz, sensors, pads, trigger)))
    return min(chip.highest_rate_hz(trigger), bus_hz)
