"""One Linux I2C bus through smbus2; another process can see which call is running."""

from __future__ import annotations

import errno
import mmap
import os
import time
from collections.abc import Callable
from pathlib import Path
from struct import Struct

import smbus2

from fmfts.sensor.chips.hmc5983 import ADDRESS, DATA, STATUS
from fmfts.sensor.lock import lock_device, not_permitted
from fmfts.sensor.source import SourceError

NOT_ACKNOWLEDGED = (errno.ENXIO, errno.EREMOTEIO, errno.EIO)  # 6 and 121; some adapters report 5
_RECORD = Struct("<QB")
_TEXT_BYTES = 80


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
    """Transfers on /dev/i2c-`number`, locked for this process; every failure raises the kernel's OSError."""

    def __init__(self, number: int, record: CallRecord) -> None:
        self.path = f"/dev/i2c-{number}"
        self.place = ""  # mux and channels of the next calls, for the record
        self._number = number
        self._record = record
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
        message = smbus2.i2c_msg.write(address, data)
        self._call(f"writing {data.hex(' ')} to 0x{address:02x}", lambda: self._bus.i2c_rdwr(message))

    def read(self, address: int, size: int) -> bytes:
        message = smbus2.i2c_msg.read(address, size)
        self._call(f"reading {size} bytes from 0x{address:02x}", lambda: self._bus.i2c_rdwr(message))
        return bytes(message)

    def read_register(self, address: int, register: int, size: int) -> bytes:
        pointer, answer = smbus2.i2c_msg.write(address, (register,)), smbus2.i2c_msg.read(address, size)
        what = f"reading {size} bytes at register 0x{register:02x} of 0x{address:02x}"
        self._call(what, lambda: self._bus.i2c_rdwr(pointer, answer))
        return bytes(answer)

    def read_status_and_axes(self) -> tuple[int, bytes]:
        """Status register and the six data bytes of the selected chip, in one system call."""
        status, axes = smbus2.i2c_msg.read(ADDRESS, 1), smbus2.i2c_msg.read(ADDRESS, 6)
        messages = (_TO_STATUS, status, _TO_DATA, axes)
        self._call(f"reading status and axes of 0x{ADDRESS:02x}", lambda: self._bus.i2c_rdwr(*messages))
        return bytes(status)[0], bytes(axes)

    def _call(self, what: str, call: Callable[[], object]) -> None:
        self._record.begin(f"{what} ({self.place})"[:_TEXT_BYTES].encode())
        try:
            call()
        finally:
            self._record.end()


_TO_STATUS = smbus2.i2c_msg.write(ADDRESS, (STATUS,))
_TO_DATA = smbus2.i2c_msg.write(ADDRESS, (DATA,))
