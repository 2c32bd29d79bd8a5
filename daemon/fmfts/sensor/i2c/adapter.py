"""The kernel's I2C adapter of a bus, and its limits, so that its faults are not reported as faults of wires.

What each driver refuses and reports: lab/results/chip-facts.md.
"""

from __future__ import annotations

import errno
import re
from dataclasses import dataclass
from pathlib import Path

from fmfts.sensor.chips.rates import BusLoad

FUNCTION_I2C = 0x1  # I2C_FUNC_I2C, include/uapi/linux/i2c.h
DEVICES = Path("/sys/bus/i2c/devices")
# Documentation/i2c/fault-codes.rst of the kernel; before anything was on the wires
REFUSED = (errno.EOPNOTSUPP, errno.EINVAL)
GONE = (errno.ENODEV, errno.ESHUTDOWN)
# An address that nobody acknowledges: 6 and 121; the FT260's driver reports 5, the CP2112's 110.
NOT_ACKNOWLEDGED = (errno.ENXIO, errno.EREMOTEIO, errno.EIO)
STUCK = (errno.ETIMEDOUT, errno.EAGAIN, errno.EBUSY)
# By driver: the shortest time of a write, and of a write with a read. A report to a HID device waits 1 ms, a frame of
# USB.
USB_S = {"mcp2221": (3e-3, 6e-3), "ft260": (1e-3, 2e-3), "cp2112": (2e-3, 3e-3)}
ANY_USB_S = (1e-3, 1e-3)


@dataclass(frozen=True, slots=True)
class Adapter:
    """name: the kernel's, "" if it says none. driver: of the controller. clock_hz: as the device tree has it."""

    name: str = ""
    driver: str = ""
    clock_hz: int | None = None
    is_usb: bool = False

    def __str__(self) -> str:
        return f"{self.name or 'unknown adapter'}{f', driver {self.driver}' if self.driver else ''}"

    def not_acknowledged(self, error: OSError) -> bool:
        return error.errno in NOT_ACKNOWLEDGED or (self.driver == "cp2112" and error.errno == errno.ETIMEDOUT)

    def highest_rate_hz(self, load: BusLoad) -> int | None:
        """The largest rate of frames through USB, whatever the clock of the bus; None if it is not on USB.

        A sensor takes at least a selection of its channel and one exchange.
        """
        if not self.is_usb:
            return None
        write_s, exchange_s = USB_S.get(self.driver, ANY_USB_S)
        of_muxes = load.sensors + load.changes + load.groups if load.muxed else 0  # written, and read back
        return int(1.0 / (of_muxes * write_s + load.sensors * exchange_s))


def adapter_of(bus: int) -> Adapter:
    """What sysfs says of /dev/i2c-`bus`; no call of the bus, so it cannot hang."""
    device = (DEVICES / f"i2c-{bus}").resolve()
    controller = device.parent
    driver = controller / "driver"
    return Adapter(
        _text(device / "name"),
        driver.readlink().name if driver.is_symlink() else "",
        _clock_hz(controller / "of_node" / "clock-frequency"),
        any(re.fullmatch(r"usb\d+", part) for part in device.parts),
    )


def _text(file: Path) -> str:
    try:
        return file.read_text(errors="replace").strip()
    except OSError:
        return ""


def _clock_hz(file: Path) -> int | None:
    """A device tree's number: 32 bits, the highest first."""
    try:
        return int.from_bytes(file.read_bytes()[:4], "big") or None
    except OSError:
        return None


def smbus_only(path: str, adapter: Adapter) -> str:
    return (
        f"{path} ({adapter}) is an SMBus controller that makes no I2C transfers, and these chips need them: "
        "use an I2C bus (`i2cdetect -l` lists them), or connect the chips to a board"
    )


def why_not_possible(path: str, adapter: Adapter, what: str, error: OSError) -> str | None:
    """The sentence if the adapter is at fault, not the wires; else None."""
    if error.errno in GONE:
        return f"{path}: its adapter ({adapter}) is gone: {error.strerror}. Plug it in again"
    if error.errno not in REFUSED:
        return None
    return (
        f"{path}: its adapter ({adapter}) refuses {what}: {error.strerror}. The wires are not at fault: "
        "use another adapter, or other chips"
    )


def clock_differs(adapter: Adapter, clock_hz: int) -> str | None:
    """A warning where the bus has another clock than the configuration says; None where it is the same, or unknown."""
    if adapter.clock_hz in (None, clock_hz):
        return None
    return (
        f"the device tree says {adapter.clock_hz} Hz for this bus, and [pad.source] clock_hz is {clock_hz}: set it to "
        f"{adapter.clock_hz}, or change the clock (on a Raspberry Pi: dtparam=i2c_arm_baudrate={clock_hz})"
    )


def usb_limit(adapter: Adapter, load: BusLoad) -> str:
    """What follows an adapter's name; "" where it is not on USB."""
    most_hz = adapter.highest_rate_hz(load)
    return "" if most_hz is None else f", through USB: at most {most_hz} frames/s of {load.sensors} sensors"


def too_fast_for_usb(adapter: Adapter, load: BusLoad, rate_hz: int) -> str | None:
    most_hz = adapter.highest_rate_hz(load)
    if most_hz is None or rate_hz <= most_hz:
        return None
    return (
        f"rate_hz is {rate_hz}, and each transfer of this adapter goes through USB, which carries at most "
        f"{most_hz} frames/s: lower rate_hz, or connect the chips to a board"
    )
