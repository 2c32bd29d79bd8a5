"""Serial ports on Linux: opening and closing without waiting, and what /sys says about the adapter."""

from __future__ import annotations

import errno
import math
import os
import termios
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import serial

from fmfts.sensor.lock import in_use, not_permitted
from fmfts.sensor.wire.packets import LINE_BITS_PER_BYTE

SYS_CLASS_TTY = Path("/sys/class/tty")
PORTS = ("/dev/serial/by-id/*", "/dev/ttyACM*", "/dev/ttyUSB*")


def candidates(root: Path = Path("/")) -> list[str]:
    """Serial ports, each once, by its stable name if it has one."""
    found: dict[Path, str] = {}
    for pattern in PORTS:
        for path in sorted(root.glob(pattern.removeprefix("/"))):
            found.setdefault(path.resolve(), str(path))
    return list(found.values())


def open_raw(port: str, baud: int) -> serial.Serial:
    """The port, locked for this process, 8N1 and non-blocking: reads raise BlockingIOError while there are no bytes.

    Raises OSError (SerialException is one).
    """
    try:
        device = serial.Serial(port, baud, timeout=0, write_timeout=0, exclusive=True)
    except serial.SerialException as error:
        if isinstance(error.__context__, termios.error):  # pyserial has the error's number only in a text
            raise OSError(*error.__context__.args) from error
        raise
    try:
        attributes = termios.tcgetattr(device.fileno())
        # pyserial sets VMIN to 0; then a read returns 0 bytes both when there is nothing yet and after a hang-up.
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(device.fileno(), termios.TCSANOW, attributes)
    except termios.error as error:
        device.close()
        raise OSError(*error.args) from error
    return device


def presence(paths: Iterable[Path | str]) -> frozenset[tuple[str, int, int, int]]:
    """Which of `paths` exist; the value changes when a device is plugged in, or its mode or group is set."""
    there = set()
    for path in paths:
        with suppress(OSError):
            node = os.stat(path)
            there.add((str(path), node.st_rdev, node.st_ino, node.st_ctime_ns))
    return frozenset(there)


def is_named(port: str, device: serial.Serial) -> bool:
    """False if the port's name is gone or now belongs to another device."""
    try:
        return os.path.samestat(os.stat(port), os.fstat(device.fileno()))
    except OSError:
        return False


def close(device: serial.Serial) -> None:
    """Close without waiting for bytes that an unplugged adapter will never send."""
    with suppress(termios.error, OSError):  # a missing device has nothing to flush
        termios.tcflush(device.fileno(), termios.TCIOFLUSH)
    device.close()


def why_not_open(port: str, error: OSError) -> str:
    """Why the port does not open, as the end of a sentence that begins with the port."""
    match error.errno:
        case errno.ENOTTY | errno.EISDIR:
            return "is not a serial port: see /dev/serial/by-id for those that are"
        case errno.ENOENT | errno.ENXIO | errno.ENODEV:
            return "does not exist (is the board plugged in?)"
        case errno.EACCES | errno.EPERM:
            return not_permitted(error, group="dialout")
        case errno.EAGAIN | errno.EBUSY:
            return in_use(port).removeprefix(f"{port} ")
        case code:
            return f"does not open: {os.strerror(code) if code else error}"


def transfer_ns(port: str, baud: int, size: int) -> int:
    """Time that `size` bytes take on the port's UART; 0 if it has none."""
    return round(size * 1e9 / bytes_per_s(port, baud))


def bytes_per_s(port: str, baud: int) -> float:
    """The rate of the port's UART; infinite if it has none (a pty, or a board's own USB)."""
    driver = SYS_CLASS_TTY / Path(os.path.realpath(port)).name / "device" / "driver"
    has_none = not driver.exists() or driver.resolve().name == "cdc_acm"
    return math.inf if has_none else baud / LINE_BITS_PER_BYTE


def latency_warning(port: str) -> str | None:
    """A sentence if an FTDI adapter holds bytes back: it does so for `latency_timer` ms, 16 by default."""
    timer = SYS_CLASS_TTY / Path(os.path.realpath(port)).name / "device" / "latency_timer"
    try:
        milliseconds = int(timer.read_text())
    except (OSError, ValueError):
        return None  # no FTDI adapter
    if milliseconds <= 1:
        return None
    return f"{port} holds bytes back for up to {milliseconds} ms: write 1 to {timer} (the shipped udev rule does)"
