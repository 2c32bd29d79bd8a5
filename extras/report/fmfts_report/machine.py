"""The computer: versions, kernel, I2C adapters and serial ports. Unreadable facts are omitted."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import smbus2

from fmfts import __version__
from fmfts.sensor.i2c.adapter import adapter_of
from fmfts.sensor.wire.codec import VERSION as WIRE_VERSION
from fmfts_client import SCHEMA_VERSION

PACKAGES = ("numpy", "scipy", "pyzmq", "msgpack", "msgspec", "onnxruntime", "smbus2", "pyserial", "mcap", "zstandard")
OF_RELEASE = ("PRETTY_NAME", "VERSION_ID", "ID", "VARIANT")
LONGEST = 4096  # bytes of a file of /sys or /proc

# Bits of I2C_FUNCS that our drivers need (linux/i2c.h).
FUNCTIONS = {
    0x0000_0001: "I2C",
    0x0000_0002: "10-bit addresses",
    0x0000_0004: "protocol mangling",
    0x0000_0010: "no start",
}


def versions() -> dict[str, Any]:
    packages = {}
    for name in PACKAGES:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = "not installed"
    return {
        "fmfts": __version__,
        "wire": WIRE_VERSION,
        "schema": SCHEMA_VERSION,
        "python": platform.python_version(),
        "packages": packages,
    }


def machine(root: Path = Path("/")) -> dict[str, Any]:
    release = _text(root / "etc/os-release").splitlines()
    named = dict(line.partition("=")[::2] for line in release)
    return _present(
        {
            "kernel": f"{platform.system()} {platform.release()} {platform.version()}",
            "architecture": platform.machine(),
            "distribution": ", ".join(named[key].strip('"') for key in OF_RELEASE if key in named),
            "model": _text(root / "proc/device-tree/model").rstrip("\0"),
            "processors": os.cpu_count(),
        }
    )


def environment(environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    return {name: value for name, value in sorted(environ.items()) if name.startswith("FMFTS_")}


def adapter(bus: int) -> dict[str, Any]:
    """The I2C adapter behind /dev/i2c-`bus`, as the kernel describes it."""
    found = adapter_of(bus)
    return _present(
        {
            "bus": bus,
            "name": found.name,
            "driver": found.driver,
            "clock_hz": found.clock_hz,
            "is_usb": found.is_usb,
            "functions": _functions(bus),
        }
    )


def adapters(root: Path = Path("/")) -> list[int]:
    """The numbers of all I2C buses of this computer."""
    names = (each.name.removeprefix("i2c-") for each in root.glob("dev/i2c-*"))
    return sorted(int(name) for name in names if name.isdigit())


def _functions(bus: int) -> str:
    """The adapter's functions, or why they are unknown. Asking sends nothing over the wires."""
    try:
        with smbus2.SMBus(bus) as opened:
            bits = int(opened.funcs)
    except OSError as error:
        return f"not known: {error.strerror}"
    named = [name for bit, name in FUNCTIONS.items() if bits & bit]
    return f"0x{bits:08x} ({', '.join(named) or 'SMBus only'})"


def serial_port(port: str, root: Path = Path("/")) -> dict[str, Any]:
    tty = Path(os.path.realpath(port)).name
    device = root / f"sys/class/tty/{tty}/device"
    # A usb_serial port hangs on its interface, and that on the device; a CDC ACM port hangs on the interface itself.
    ancestors = (device.resolve(), *device.resolve().parents[:4]) if device.exists() else ()
    usb = next((place for place in ancestors if (place / "idVendor").exists()), None)
    return _present(
        {
            "port": port,
            "tty": tty,
            "driver": _target(device / "driver"),
            "usb": f"{_text(usb / 'idVendor')}:{_text(usb / 'idProduct')}" if usb is not None else "",
            "product": _text(usb / "product") if usb is not None else "",
            "latency_timer_ms": _text(device / "latency_timer"),
        }
    )


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(LONGEST)
    except OSError:
        return b""


def _text(path: Path) -> str:
    return _bytes(path).decode(errors="replace").strip()


def _target(link: Path) -> str:
    return link.resolve().name if link.exists() else ""


def _present(facts: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in facts.items() if value not in ("", None)}


def ports_of(configured: Iterable[str], found: Iterable[str]) -> list[str]:
    """Each port once: those of the configuration, and the existing ones."""
    known: dict[str, str] = {}
    for port in (*configured, *found):
        known.setdefault(os.path.realpath(port), port)
    return list(known.values())
