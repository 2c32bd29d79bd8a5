"""One Linux I2C bus through smbus2; another process can see which call is running."""

from __future__ import annotations

import errno
import mmap
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from struct import Struct

import smbus2

from fmfts.sensor.i2c.adapter import FUNCTION_I2C, adapter_of, smbus_only, why_not_possible
from fmfts.sensor.lock import lock_device, not_permitted
from fmfts.sensor.source import SourceError

_RECORD = Struct("<QB")
_TEXT_BYTES = 80
MOST_WRITES_KEPT = 256


class CallRecord:
    """The running bus call, in memory shared with the daemon: a process that is stuck in the call cannot report it."""

    def __init__(self, descriptor: int | None = None) -> None:
        if descriptor is None:
            descriptor = os.memfd_create("fmfts-i2c-call")
            os.ftruncate(descriptor, mmap.PAGESIZE)
        self.descriptor = descriptor
        self._memory = mmap.mmap(descriptor, mmap.PAGESIZE)

    def begin(self, text: bytes) -> None:
        self._memory[_RECORD.size : _RECORD.size + len(text)] = text
        self._memory[: _RECORD.size] = _RECORD.pack(time.monotonic_ns(), len(text))

    def end(self) -> None:
        self._memory[:8] = b"\0\0\0\0\0\0\0\0"

    def current(self) -> tuple[int, str] | None:
        """(CLOCK_MONOTONIC at its start, description of the call); None while no call is running."""
        since_ns, size = _RECORD.unpack(self._memory[: _RECORD.size])
        if not since_ns:
            return None
        return since_ns, self._memory[_RECORD.size : _RECORD.size + size].decode(errors="replace")

    def close(self) -> None:
        self._memory.close()
        os.close(self.descriptor)


class I2cBus:
    """Transfers on /dev/i2c-`number`, locked for this process.

    A failure raises the kernel's OSError, or SourceError if the adapter itself is the cause and would fail again.
    """

    def __init__(self, number: int, record: CallRecord) -> None:
        self.path = f"/dev/i2c-{number}"
        self.place = ""  # mux and channels of the next calls, for the record
        self.adapter = adapter_of(number)
        self._number = number
        self._record = record
        self._writes: dict[tuple[int, bytes], smbus2.i2c_msg] = {}  # messages of `exchange`: the same few all the time
        try:
            self._lock = os.open(self.path, os.O_RDWR | os.O_CLOEXEC)
            lock_device(self._lock, self.path)
            self._bus = smbus2.SMBus(self.path)
        except FileNotFoundError:
            raise SourceError(f"{self.path} does not exist: enable I2C (raspi-config, or `modprobe i2c-dev`)") from None
        except PermissionError as error:
            raise SourceError(f"{self.path} {not_permitted(error, group='i2c')}") from None
        except OSError as error:
            raise SourceError(f"{self.path} does not open: {error.strerror}") from None
        if not self._bus.funcs & FUNCTION_I2C:
            raise SourceError(smbus_only(self.path, self.adapter))

    def require_unbound(self, address: int) -> None:
        """SourceError if a kernel driver owns `address`: transfers would still work, and disturb the driver."""
        try:
            self._call(f"probing 0x{address:02x}", lambda: self._bus.read_byte(address))
        except OSError as error:
            if error.errno == errno.EBUSY:
                device = Path(f"/sys/bus/i2c/devices/{self._number}-{address:04x}")
                driver = (device / "driver").resolve().name if (device / "driver").exists() else "a driver"
                raise SourceError(
                    f"0x{address:02x} on {self.path} is bound by the kernel: {driver} owns it; remove its overlay, or "
                    f"echo {device.name} > /sys/bus/i2c/devices/{device.name}/driver/unbind"
                ) from None

    def write(self, address: int, data: bytes) -> None:
        self._transfer(f"writing {data.hex(' ')} to 0x{address:02x}", smbus2.i2c_msg.write(address, data))

    def read(self, address: int, size: int) -> bytes:
        answer = smbus2.i2c_msg.read(address, size)
        self._transfer(f"reading {size} bytes from 0x{address:02x}", answer)
        return bytes(answer)

    def exchange(self, address: int, data: bytes, count: int) -> bytes:
        """Write `data` and read `count` bytes after a repeated start, in one system call."""
        answer = smbus2.i2c_msg.read(address, count)
        what = f"reading from 0x{address:02x} after writing {data.hex(' ')}"
        self._transfer(what, self._write_of(address, data), answer)
        return bytes(answer)

    def _transfer(self, what: str, *messages: smbus2.i2c_msg) -> None:
        try:
            self._call(what, lambda: self._bus.i2c_rdwr(*messages))
        except OSError as error:
            sentence = why_not_possible(self.path, self.adapter, what, error)
            if sentence is None:
                raise
            raise SourceError(sentence) from error

    def _write_of(self, address: int, data: bytes) -> smbus2.i2c_msg:
        key = address, data
        if key not in self._writes:
            if len(self._writes) >= MOST_WRITES_KEPT:
                self._writes.clear()
            self._writes[key] = smbus2.i2c_msg.write(address, data)
        return self._writes[key]

    def _call(self, what: str, call: Callable[[], object]) -> None:
        self._record.begin(f"{what} ({self.place})"[:_TEXT_BYTES].encode())
        try:
            call()
        finally:
            self._record.end()


@dataclass(frozen=True, slots=True)
class ChipWires:
    """The bus as the chip at `address` sees it: `Wires` of chips/driver.py."""

    bus: I2cBus
    address: int

    def write(self, data: bytes) -> None:
        self.bus.write(self.address, data)

    def exchange(self, data: bytes, count: int) -> bytes:
        return self.bus.exchange(self.address, data, count)
