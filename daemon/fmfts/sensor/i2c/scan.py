"""Finds the muxes and chips on an I2C bus, whatever the configuration says: `python -m fmfts.sensor.i2c.scan BUS`.

A process of its own, because a wedged bus blocks each call for seconds. It prints JSON, or ends with 1 and a sentence.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence

import msgspec

from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips import tca9548a as mux
from fmfts.sensor.i2c.bus import CallRecord, I2cBus
from fmfts.sensor.i2c.others import chips_answering
from fmfts.sensor.source import SourceError

PATIENCE_S = 10.0


class Found(msgspec.Struct, frozen=True):
    """A chip, by its name in the configuration. mux_address, channel: None where it is straight on the bus."""

    chip: str
    address: int
    mux_address: int | None = None
    channel: int | None = None

    def __str__(self) -> str:
        label = CHIPS[self.chip].label
        if self.mux_address is None:
            return f"{label} at 0x{self.address:02X}"
        return f"{label} at 0x{self.address:02X}, mux 0x{self.mux_address:02x}, channel {self.channel}"


def scanned(bus: int) -> list[Found]:
    """What is on the bus now. SourceError if it cannot be opened, is in use, or hangs."""
    command = [sys.executable, "-m", "fmfts.sensor.i2c.scan", str(bus)]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        raise SourceError(f"/dev/i2c-{bus} hangs: look for SDA or SCL held low") from None
    if ended.returncode != 0:
        raise SourceError((ended.stderr.strip().splitlines() or [f"its scan ended with {ended.returncode}"])[-1])
    return msgspec.json.decode(ended.stdout, type=list[Found])


def scan(bus: I2cBus) -> Iterator[Found]:
    """First the chips without a mux: behind a mux they answer on every channel."""
    muxes = [address for address in mux.ADDRESSES if _is_mux(bus, address)]
    direct = [(chip, address) for chip, address in chips_answering(bus)]
    yield from (Found(chip.name, address) for chip, address in direct)
    straight = {address for _, address in direct}
    for mux_address in muxes:
        for channel in range(mux.CHANNELS):
            bus.write(mux_address, bytes((mux.one(channel),)))
            for chip, address in chips_answering(bus):
                if address not in straight:
                    yield Found(chip.name, address, mux_address, channel)
        bus.write(mux_address, bytes((mux.NO_CHANNEL,)))


def _is_mux(bus: I2cBus, address: int) -> bool:
    """It holds its control byte. Ends with no channel open."""
    try:
        for control in (mux.one(3), mux.NO_CHANNEL):
            bus.write(address, bytes((control,)))
            if bus.read(address, 1) != bytes((control,)):
                return False
    except OSError:
        return False
    return True


def main(arguments: Sequence[str]) -> int:
    try:
        found = list(scan(I2cBus(int(arguments[0]), CallRecord())))
    except (SourceError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    print(msgspec.json.encode(found).decode())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
