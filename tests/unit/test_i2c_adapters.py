"""What the adapters of Linux refuse (their emulation, from the kernel's source), and what the daemon says of one."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
from emulated_bus import Clock, clock, emulated_pad

from emulator.i2c_adapters import ADAPTERS, I2C, READ, Message
from emulator.magnetometers import Qmc5883l
from fmfts.sensor.chips.rates import BusLoad
from fmfts.sensor.i2c import adapter as adapter_module
from fmfts.sensor.i2c.adapter import Adapter, adapter_of, clock_differs, too_fast_for_usb, usb_limit, why_not_possible
from fmfts.sensor.wire.packets import SensorState

__all__ = ["clock"]
WRITE_1, WRITE_3, READ_6, OTHER = (
    Message(0x1E, 0, 1),
    Message(0x1E, 0, 3),
    Message(0x1E, READ, 6),
    Message(0x70, 0, 1),
)
OLD_SAMPLE = [WRITE_1, Message(0x1E, READ, 1), WRITE_1, READ_6]  # of the HMC5983, before it was two transfers
NO, BAD = errno.EOPNOTSUPP, errno.EINVAL
# The answer of each kind of bus to these messages, by the functions that the head of i2c_adapters.py names.
TRANSFERS = {
    "write": [WRITE_3],
    "read": [READ_6],
    "write, read": [WRITE_1, READ_6],
    "write three, read": [WRITE_3, READ_6],
    "read, write": [READ_6, WRITE_1],
    "write, read, write, read": OLD_SAMPLE,
    "write to another, read": [OTHER, READ_6],
    "nothing": [Message(0x1E, 0, 0)],
    "too many": [WRITE_1] * 43,
}
ANSWERS = {
    "bcm2835": (0, 0, 0, 0, NO, NO, 0, 0, BAD),
    "designware": (0, 0, 0, 0, 0, 0, BAD, NO, BAD),
    "tegra": (0, 0, 0, 0, 0, 0, 0, NO, BAD),
    "imx": (0, 0, 0, 0, 0, 0, 0, 0, BAD),
    "gpio": (0, 0, 0, 0, 0, 0, 0, 0, BAD),
    "i801": (NO, NO, NO, NO, NO, NO, NO, NO, BAD),
    "mcp2221": (0, 0, 0, 0, NO, NO, NO, 0, BAD),
    "ft260": (0, 0, 0, NO, NO, NO, NO, 0, BAD),
    "cp2112": (0, 0, 0, 0, NO, NO, NO, 0, BAD),
}
FOUR_BEHIND_A_MUX = BusLoad(4, 1)


@pytest.mark.parametrize("kind", ADAPTERS)
def test_emulated_adapter_refuses_what_its_driver_refuses(kind: str) -> None:
    adapter = ADAPTERS[kind]
    assert tuple(adapter.refusal(messages) for messages in TRANSFERS.values()) == ANSWERS[kind]


@pytest.mark.parametrize("kind", ADAPTERS)
@pytest.mark.parametrize(
    ("failure", "state"),
    [("no answer", SensorState.NO_ANSWER), (errno.EAGAIN, SensorState.BUS_STUCK), (errno.EIO, SensorState.NO_ANSWER)],
)
def test_error_of_an_adapter_becomes_the_state_of_a_sensor(
    kind: str, failure: str | int, state: SensorState, clock: Clock
) -> None:
    pad, bus = emulated_pad(clock, "qmc5883l", [Qmc5883l(clock)], muxed=False)
    bus.adapter = Adapter(driver=ADAPTERS[kind].driver)
    bus.error = OSError(ADAPTERS[kind].no_answer if failure == "no answer" else failure, "")
    pad.poll()
    assert pad.sensors[0].state == state


def test_time_out_means_no_answer_on_a_cp2112_alone(clock: Clock) -> None:
    for driver, state in (("i2c-bcm2835", SensorState.BUS_STUCK), ("cp2112", SensorState.NO_ANSWER)):
        pad, bus = emulated_pad(clock, "qmc5883l", [Qmc5883l(clock)], muxed=False)
        bus.adapter = Adapter(driver=driver)
        bus.error = OSError(errno.ETIMEDOUT, "")
        pad.poll()
        assert pad.sensors[0].state == state


def made(folder: Path, monkeypatch: pytest.MonkeyPatch, device: str, **files: bytes) -> Adapter:
    """The adapter of bus 7, with these files of its controller."""
    there = folder / "devices" / device / "i2c-7"
    (there.parent / "of_node").mkdir(parents=True)
    there.mkdir()
    (there / "name").write_text("a name\n")
    (there.parent / "driver").symlink_to("../../../bus/platform/drivers/a-driver")
    for name, content in files.items():
        (there.parent / "of_node" / name.replace("_", "-")).write_bytes(content)
    (folder / "i2c-7").symlink_to(there)
    monkeypatch.setattr(adapter_module, "DEVICES", folder)
    return adapter_of(7)


def test_adapter_is_found_in_sysfs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = made(tmp_path, monkeypatch, "platform/fe804000.i2c", clock_frequency=(400_000).to_bytes(4, "big"))
    assert found == Adapter("a name", "a-driver", 400_000)
    assert str(found) == "a name, driver a-driver"
    assert adapter_of(8) == Adapter()
    assert str(adapter_of(8)) == "unknown adapter"


def test_adapter_on_usb_has_a_highest_rate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = made(tmp_path, monkeypatch, "platform/usb1/1-1/1-1:1.0/0003:0001")
    assert found == Adapter("a name", "a-driver", is_usb=True)
    assert usb_limit(found, FOUR_BEHIND_A_MUX) == ", through USB: at most 111 frames/s of 4 sensors"
    assert usb_limit(Adapter("a name"), FOUR_BEHIND_A_MUX) == ""
    assert too_fast_for_usb(found, FOUR_BEHIND_A_MUX, 111) is None
    said = too_fast_for_usb(found, FOUR_BEHIND_A_MUX, 112)
    assert said is not None
    assert said.startswith(
        "rate_hz is 112, and each transfer of this adapter goes through USB, which carries at most 111"
    )


@pytest.mark.parametrize("kind", ["mcp2221", "ft260", "cp2112"])
def test_rate_through_usb_is_what_the_bridges_driver_can_do(kind: str) -> None:
    """A frame of four chips behind a mux: five transfers of the mux, four exchanges."""
    emulated = ADAPTERS[kind]
    least_s = 5 * emulated.took_s([WRITE_1]) + 4 * emulated.took_s([WRITE_1, READ_6])
    assert Adapter(driver=emulated.driver, is_usb=True).highest_rate_hz(FOUR_BEHIND_A_MUX) == int(1.0 / least_s)


def test_other_clock_of_the_device_tree_names_both_numbers() -> None:
    said = clock_differs(Adapter(clock_hz=100_000), 400_000)
    assert said is not None
    assert said.startswith("the device tree says 100000 Hz for this bus, and [pad.source] clock_hz is 400000")
    assert clock_differs(Adapter(clock_hz=400_000), 400_000) is None
    assert clock_differs(Adapter(), 400_000) is None


def test_refusal_names_the_adapter_and_clears_the_wires() -> None:
    adapter = Adapter("MCP2221 usb-i2c bridge", "mcp2221", is_usb=True)
    for number in (errno.EOPNOTSUPP, errno.EINVAL):
        said = why_not_possible("/dev/i2c-7", adapter, "reading 1 byte", OSError(number, "Not so"))
        assert said is not None
        assert said.startswith(
            "/dev/i2c-7: its adapter (MCP2221 usb-i2c bridge, driver mcp2221) refuses reading 1 byte"
        )
        assert "wires are not at fault" in said
    gone = why_not_possible("/dev/i2c-7", adapter, "reading 1 byte", OSError(errno.ENODEV, "No such device"))
    assert gone is not None
    assert "is gone: No such device. Plug it in again" in gone
    assert why_not_possible("/dev/i2c-7", adapter, "reading", OSError(errno.EREMOTEIO, "")) is None


def test_only_the_smbus_controller_has_no_i2c() -> None:
    assert [kind for kind, adapter in ADAPTERS.items() if not adapter.functions & I2C] == ["i801"]
