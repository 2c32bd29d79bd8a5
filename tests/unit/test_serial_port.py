"""What /sys tells of a serial adapter, and why one does not open."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from fmfts.sensor.bridge import serial_port


@pytest.fixture
def adapter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ttyUSB0 as the kernel shows it, without driver or timer."""
    monkeypatch.setattr(serial_port, "SYS_CLASS_TTY", tmp_path)
    device = tmp_path / "ttyUSB0" / "device"
    device.mkdir(parents=True)
    return device


def test_adapter_that_holds_bytes_back_is_warned_of(adapter: Path) -> None:
    (adapter / "latency_timer").write_text("16\n")
    warning = serial_port.latency_warning("/dev/ttyUSB0")
    assert warning is not None
    assert "up to 16 ms: write 1 to" in warning
    (adapter / "latency_timer").write_text("1\n")
    assert serial_port.latency_warning("/dev/ttyUSB0") is None


def test_other_adapters_have_no_timer(adapter: Path) -> None:
    assert serial_port.latency_warning("/dev/ttyUSB0") is None
    assert serial_port.latency_warning("/dev/ttyACM0") is None


def test_bytes_take_time_on_a_uart_and_none_on_usb(adapter: Path, tmp_path: Path) -> None:
    drivers = tmp_path / "drivers"
    for name in ("ftdi_sio", "cdc_acm"):
        (drivers / name).mkdir(parents=True)
    assert serial_port.transfer_ns("/dev/ttyUSB0", 460_800, 53) == 0
    (adapter / "driver").symlink_to(drivers / "ftdi_sio")
    assert serial_port.transfer_ns("/dev/ttyUSB0", 460_800, 53) == 1_150_174  # 530 bits
    (adapter / "driver").unlink()
    (adapter / "driver").symlink_to(drivers / "cdc_acm")
    assert serial_port.transfer_ns("/dev/ttyUSB0", 460_800, 53) == 0


@pytest.mark.parametrize(("code", "words"), [(errno.EPERM, "systemctl restart fmfts"), (errno.EACCES, "dialout")])
def test_service_without_device_and_user_without_group_differ(code: int, words: str) -> None:
    assert words in serial_port.why_not_open("/dev/ttyUSB0", OSError(code, os.strerror(code)))
