"""How many readings a second chip, board and bus allow: one definition for config checks, bridge and reader."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from fmfts.sensor.chips.chip import Chip

USUAL_RATE_HZ = 220
BRIDGE_HZ = 220  # firmware/wire.md, host → board: the most that the firmware accepts of any chip
BOARD_READ_US = 680  # the firmware's time for one sensor between two triggers, and for how many board_single_hz is
BOARD_READ_SENSORS = 4
# On I2C, as `Driver.sample_bits`. Select: START, address, control byte, STOP; then the chip's own transfer.
# The kernel's own time is not counted, nor the half bit for which the bus is free between transfers (UM10204, tBUF).
BITS_PER_SELECTION = 20
BITS_PER_GROUP = 20  # the mux's control byte read back


def highest_rate_hz(chip: Chip, trigger: str, *, over_bridge: bool) -> int:
    """The rate that the chips and their board allow; an I2C bus has its own limit, `i2c_rate_hz`."""
    chip_hz = chip.highest_rate_hz(trigger)
    if not over_bridge:
        return chip_hz
    return min(chip_hz, BRIDGE_HZ, chip.board_single_hz if trigger == "simultaneous" else BRIDGE_HZ)


def usual_rate_hz(chip: Chip, trigger: str, *, over_bridge: bool) -> int:
    """The default rate; any number if the chip lacks this trigger, which is refused elsewhere."""
    return min(USUAL_RATE_HZ, highest_rate_hz(chip, trigger, over_bridge=over_bridge) or USUAL_RATE_HZ)


def single_on_board_hz(chip: Chip, sensors: int) -> int:
    """Simultaneous measurements a second of so many chips on one board. It reads all of them before the next trigger,
    unless they keep their samples while they measure again."""

    def read_hz(count: int) -> int:
        return 1_000_000 // (round(chip.single_wait_s * 1e6) + BOARD_READ_US * count)

    keeps = chip.board_single_hz > read_hz(BOARD_READ_SENSORS)
    return chip.board_single_hz if keeps else min(chip.board_single_hz, read_hz(sensors))


def fastest_on_board_hz(chip: Chip, rate_hz: int) -> float:
    """The largest rate of a free-running chip's samples for frames at `rate_hz`, with its clock's tolerance."""
    rates = (*(rate for rate in chip.board_rates_hz if rate >= rate_hz), chip.board_rates_hz[-1])
    return min(rates) * (1.0 + chip.clock_tolerance)


class BusLoad(NamedTuple):
    """The load of one I2C bus. groups: of chips that one write reaches: a pad's chips behind one mux, or a whole pad
    without a mux. changes: how often reading all chips once switches from one mux of a pad to another, which closes
    the first."""

    sensors: int
    groups: int
    muxed: bool = True
    changes: int = 0

    @classmethod
    def of(cls, pads: Iterable[tuple[int, Sequence[int]]]) -> BusLoad:
        """pads: for each pad the number of its sensors, and the mux address of each (empty if it has no mux)."""
        each = list(pads)
        return cls(
            sum(sensors for sensors, _ in each),
            sum(max(len(set(muxes)), 1) for _, muxes in each),
            any(muxes for _, muxes in each),
            sum(one != other for _, muxes in each for one, other in zip(muxes, [*muxes[1:], *muxes[:1]], strict=True)),
        )


def i2c_cycle_s(chip: Chip, clock_hz: int, load: BusLoad, trigger: str) -> float:
    """Time on the wires for one reading of all sensors of a bus."""
    bits = load.sensors * chip.driver.sample_bits
    if chip.paced_by_host and trigger == "free":
        bits += load.sensors * chip.driver.trigger_bits
    if load.muxed:
        bits += (load.sensors + load.changes) * BITS_PER_SELECTION + load.groups * BITS_PER_GROUP
    if trigger == "simultaneous":
        trigger_bits = chip.driver.trigger_bits
        bits += load.groups * (BITS_PER_SELECTION + trigger_bits) if load.muxed else load.sensors * trigger_bits
    return bits / clock_hz


def i2c_rate_hz(chip: Chip, trigger: str, clock_hz: int, load: BusLoad) -> int:
    """The rate that chips and bus allow together: simultaneous conversions have to end before they can be read."""
    waiting_s = chip.single_wait_s if trigger == "simultaneous" else 0.0
    bus_hz = int(1.0 / (waiting_s + i2c_cycle_s(chip, clock_hz, load, trigger)))
    return min(chip.highest_rate_hz(trigger), bus_hz)


def no_trigger(chip: Chip) -> str:
    """The sentence for a chip that has no simultaneous measurements."""
    return f'{chip.named} measures at its own times only: set trigger = "free"'
