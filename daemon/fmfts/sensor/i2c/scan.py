"""Finds the muxes and chips on an I2C bus: `python -m fmfts.sensor.i2c.scan BUS CALL_RECORD_FD [registers]`.

With `registers` it also reads the registers of each chip. It ignores the configuration. It is a process of its own,
because a wedged bus blocks each call for seconds. It prints JSON, or ends with 1 and a sentence.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress

import msgspec

from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips import tca9548a as mux
from fmfts.sensor.i2c.bus import CallRecord, ChipWires, I2cBus
from fmfts.sensor.i2c.others import chips_answering
from fmfts.sensor.source import SourceError

STUCK_S = 2.0  # in one call; a transfer takes less than a millisecond
PATIENCE_S = 60.0  # for the whole scan: a second, but much longer on a busy computer
LOOK_S = 0.1
CLOSE_S = 1.0
REGISTERS = "registers"


class Found(msgspec.Struct, frozen=True):
    """A chip, by its name in CHIPS. mux_address, channel: None where it is straight on the bus.

    registers: lines such as "0x09: 1d 41 01" with the first register's number; empty unless requested.
    """

    chip: str
    address: int
    mux_address: int | None = None
    channel: int | None = None
    registers: tuple[str, ...] = ()

    def __str__(self) -> str:
        behind = "" if self.mux_address is None else f", mux 0x{self.mux_address:02x}, channel {self.channel}"
        return f"{CHIPS[self.chip].label} at 0x{self.address:02X}{behind}"


def scanned(bus: int, *, registers: bool = False) -> list[Found]:
    """What is on the bus now. SourceError if it cannot be opened, is in use, or hangs.

    registers: read them, too. A chip may have to be set up again after that.
    """
    record = CallRecord()
    command = [sys.executable, "-m", "fmfts.sensor.i2c.scan", str(bus), str(record.descriptor)]
    command += [REGISTERS] if registers else []
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, pass_fds=[record.descriptor])
    try:
        output, sentences = _ended(process, bus, record)
    finally:
        record.close()
    if process.returncode != 0:
        raise SourceError(
            (sentences.strip().splitlines() or [f"the scan of /dev/i2c-{bus} ended with {process.returncode}"])[-1]
        )
    return msgspec.json.decode(output, type=list[Found])


def _ended(process: subprocess.Popen[str], bus: int, record: CallRecord) -> tuple[str, str]:
    """What the scan printed on stdout and stderr. SourceError if one of its calls is stuck, or all take too long."""
    given_up_s = time.monotonic() + PATIENCE_S
    while True:
        with suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=LOOK_S)
        call, now_s = record.current(), time.monotonic()
        if call is not None and now_s - call[0] / 1e9 > STUCK_S:
            reason = f"/dev/i2c-{bus} hangs in {call[1]}: look for SDA or SCL held low"
        elif now_s > given_up_s:
            reason = f"the scan of /dev/i2c-{bus} has not ended after {PATIENCE_S:.0f} s: this computer is overloaded"
        else:
            continue
        process.kill()
        with suppress(subprocess.TimeoutExpired):  # a process that is stuck in the kernel dies when its call returns
            process.communicate(timeout=CLOSE_S)
        raise SourceError(reason)


def scan(bus: I2cBus, *, registers: bool = False) -> Iterator[Found]:
    """First the chips without a mux: behind a mux they answer on every channel."""
    muxes = [address for address in mux.ADDRESSES if _is_mux(bus, address)]
    direct = list(_answering(bus))
    yield from (
        Found(name, address, registers=_dumped(bus, name, address) if registers else ()) for name, address in direct
    )
    straight = {address for _, address in direct}
    for mux_address in muxes:
        for channel in range(mux.CHANNELS):
            bus.write(mux_address, bytes((mux.one(channel),)))
            for name, address in _answering(bus):
                if address not in straight:
                    lines = _dumped(bus, name, address) if registers else ()
                    yield Found(name, address, mux_address, channel, lines)
        bus.write(mux_address, bytes((mux.NO_CHANNEL,)))


def _answering(bus: I2cBus) -> Iterator[tuple[str, int]]:
    """The names and addresses of the chips on the selected channel."""
    yield from ((chip.name, address) for chip, address in chips_answering(bus))


def _dumped(bus: I2cBus, name: str, address: int) -> tuple[str, ...]:
    """The registers of a chip on the selected channel."""
    dump = CHIPS[name].dump
    lines = []
    try:
        for first, values in dump(ChipWires(bus, address)) if dump is not None else ():
            lines.append(f"0x{first:02x}: {values.hex(' ')}")
    except OSError as error:
        lines.append(f"then no answer: {error.strerror}")
    except SourceError as error:
        lines.append(f"then refused: {error}")
    return tuple(lines)


def _is_mux(bus: I2cBus, address: int) -> bool:
    """Whether it is a mux: it holds its control byte. Ends with no channel open."""
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
        bus = I2cBus(int(arguments[0]), CallRecord(int(arguments[1])))
        found = list(scan(bus, registers=REGISTERS in arguments[2:]))
    except SourceError as error:
        print(error, file=sys.stderr)
        return 1
    except OSError as error:
        print(f"/dev/i2c-{arguments[0]}: {error.strerror}", file=sys.stderr)
        return 1
    print(msgspec.json.encode(found).decode())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
