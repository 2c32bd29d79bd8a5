"""Emulated I2C buses for real smbus2 clients under umockdev's preload: /dev/i2c-7 with two muxes of four HMC5983 each,
and /dev/i2c-8, which no order concerns, with one.

With a kind of chip as its argument, /dev/i2c-7 has such chips instead: four behind one mux ("qmc5883l"), or one at each
address that follows, without a mux ("mlx90393 12 13 14 15"). With "hmc5983" its two muxes have eight each.

Run by the system's Python (it needs gir1.2-umockdev-1.0). Prints the test bed's directory, then obeys one JSON object
a line on stdin and prints "done" after each:
    {"chip": [mux, channel], "set": {...}}   attributes of a chip        {"mux": mux, "set": {...}}   of a mux
    {"chip": [mux, channel], "call": "power_on"}                         {"busy": [addresses]}  kernel-bound
    {"block_s": seconds}                     every transfer from now on takes that long
    {"direct": index, "set": {...}}          attributes of a chip without a mux
    {"report": true}                         prints transfers, conflicts and registers instead of "done"
"""

from __future__ import annotations

import errno
import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))
from chips import Bus, Hmc5983, NackError, Tca9548a  # noqa: E402
from magnetometers import Lis3mdl, Mmc5603nj, Mmc5983ma, Qmc5883l, Qmc5883p  # noqa: E402
from mlx90393 import Mlx90393  # noqa: E402

I2C_SLAVE, I2C_FUNCS, I2C_RDWR, I2C_SMBUS = 0x0703, 0x0705, 0x0707, 0x0720
FUNCTIONS = 0x0EFF0001  # what a plain I2C adapter of Linux offers: I2C and emulated SMBus
READ = 0x0001
DEVICE = "P: /devices/platform/soc/i2c-{0}/i2c-dev/i2c-{0}\nN: i2c-{0}\nE: DEVNAME=/dev/i2c-{0}\nE: SUBSYSTEM=i2c-dev\n"
MUXES = {7: 2, 8: 1}  # by bus
POINTER, MESSAGE = 8, 16  # bytes of a pointer and of struct i2c_msg on a 64-bit kernel


class KernelBus(UMockdev.IoctlBase):
    def __init__(self, bus: Bus) -> None:
        super().__init__()
        self.bus = bus
        self.block_s = 0.0
        self.busy: list[int] = []
        self.slave = 0
        self.muxes_written_by_others = 0

    def do_handle_ioctl(self, client: UMockdev.IoctlClient) -> bool:
        handler = {I2C_SLAVE: self._slave, I2C_FUNCS: self._funcs, I2C_RDWR: self._rdwr, I2C_SMBUS: self._smbus}
        try:
            result, error = handler[client.get_request()](client.get_arg()), 0
        except NackError:
            result, error = -1, errno.EREMOTEIO
        except OSError as failure:
            result, error = -1, failure.errno
        except GLib.Error:  # the client was killed in the middle of its call
            return True
        if self.block_s and client.get_request() in (I2C_RDWR, I2C_SMBUS):
            GLib.timeout_add(int(1000 * self.block_s), lambda: client.complete(-1, errno.ETIMEDOUT))
        else:
            client.complete(result, error)
        return True

    def _slave(self, argument: UMockdev.IoctlData) -> int:
        self.slave = _number(argument, 0, POINTER)
        if self.slave in self.busy:
            raise OSError(errno.EBUSY, "")
        return 0

    def _funcs(self, argument: UMockdev.IoctlData) -> int:
        argument.resolve(0, POINTER).update(0, list(FUNCTIONS.to_bytes(POINTER, "little")))
        return 0

    def _rdwr(self, argument: UMockdev.IoctlData) -> int:
        request = argument.resolve(0, 2 * POINTER)
        count = _number(request, POINTER, 4)
        table = request.resolve(0, MESSAGE * count)
        messages, buffers = [], []
        for start in range(0, MESSAGE * count, MESSAGE):
            address, flags, size = (_number(table, start + offset, 2) for offset in (0, 2, 4))
            buffers.append(table.resolve(start + 8, size))
            messages.append((address, size if flags & READ else bytes(buffers[-1].retrieve())))
        for buffer, answer in zip(buffers, self.bus.transfer(messages), strict=True):
            if answer:
                buffer.update(0, list(answer))
        return count

    def _smbus(self, argument: UMockdev.IoctlData) -> int:
        request = argument.resolve(0, 2 * POINTER)
        reading, command, size = _number(request, 0, 1), _number(request, 1, 1), _number(request, 4, 4)
        data = request.resolve(8, 34) if size != 1 or reading else None
        if size == 1:  # byte
            (answer,) = self.bus.transfer([(self.slave, 1 if reading else bytes([command]))])
        elif size == 2 and reading:  # byte data
            _, answer = self.bus.transfer([(self.slave, bytes([command])), (self.slave, 1)])
        elif size == 2:
            (answer,) = self.bus.transfer([(self.slave, bytes([command, _number(data, 0, 1)]))])
        elif size == 8 and reading:  # I2C block data, its length first
            length = _number(data, 0, 1)
            _, block = self.bus.transfer([(self.slave, bytes([command])), (self.slave, length)])
            answer = bytes([length]) + block
        else:
            raise OSError(errno.EOPNOTSUPP, "")
        if reading and data is not None:
            data.update(0, list(answer))
        return 0


def _number(data: UMockdev.IoctlData, offset: int, size: int) -> int:
    return int.from_bytes(bytes(data.retrieve())[offset : offset + size], "little")


def obey(kernel: KernelBus, order: dict) -> str:
    target = None
    if "chip" in order:
        mux, channel = order["chip"]
        target = kernel.bus.muxes[mux].channels[channel]
    elif "direct" in order:
        target = kernel.bus.chips[order["direct"]]
    elif "mux" in order:
        target = kernel.bus.muxes[order["mux"]]
    for name, value in order.get("set", {}).items():
        if name == "identification":
            value = value.encode()
        if not hasattr(target, name):
            raise AttributeError(name)
        setattr(target, name, value)
    for name, value in order.get("registers", {}).items():
        target.registers[int(name)] = value
    if "call" in order:
        getattr(target, order["call"])()
    kernel.block_s = order.get("block_s", kernel.block_s)
    kernel.busy = order.get("busy", kernel.busy)
    if "report" in order:
        chips = [chip for mux in kernel.bus.muxes for chip in mux.channels.values()] + list(kernel.bus.chips)
        registers = [list(chip.registers[:3]) for chip in chips]
        conflicts = kernel.bus.conflicts
        return json.dumps({"transfers": kernel.bus.transfers, "conflicts": conflicts, "registers": registers})
    return "done"


def main() -> None:
    with suppress(PermissionError):  # chips wait for no processor; without the right to this, they do when it is busy
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    testbed = UMockdev.Testbed.new()
    buses = {number: Bus(some_muxes(count)) for number, count in MUXES.items()}
    if sys.argv[1:] == ["hmc5983"]:
        buses[7] = Bus(some_muxes(MUXES[7], 8))
    elif len(sys.argv) > 1:
        buses[7] = bus_of(sys.argv[1], [int(each) for each in sys.argv[2:]])
    kernels = {number: KernelBus(bus) for number, bus in buses.items()}
    for number, kernel in kernels.items():
        testbed.add_from_string(DEVICE.format(number))
        testbed.attach_ioctl(f"/dev/i2c-{number}", kernel)
    loop = GLib.MainLoop()

    def on_order(*_: object) -> bool:
        line = sys.stdin.readline()
        if not line:
            loop.quit()
            return False
        print(obey(kernels[7], json.loads(line)), flush=True)
        return True

    GLib.io_add_watch(sys.stdin.fileno(), GLib.IO_IN | GLib.IO_HUP, on_order)
    print(testbed.get_root_dir(), flush=True)
    loop.run()


def some_muxes(count: int, chips: int = 4) -> list[Tca9548a]:
    start = time.monotonic()
    return [
        Tca9548a(
            0x70 + m,
            {
                channel: Hmc5983(
                    lambda: time.monotonic() - start,
                    field_gauss=(0.1 * (channel + 1), -0.05 * (channel + 1), 0.3 + m),
                    clock_error=(channel % 4 - 1.5) * 0.02,
                    phase_s=0.001 * channel,
                )
                for channel in range(chips)
            },
        )
        for m in range(count)
    ]


def bus_of(kind: str, addresses: list[int]) -> Bus:
    """Four chips of another kind, with the fields of `some_muxes`."""
    kinds = (Qmc5883l, Qmc5883p, Lis3mdl, Mmc5983ma, Mmc5603nj, Mlx90393)
    made = {each.__name__.lower(): each for each in kinds}[kind]
    start = time.monotonic()
    chips = [
        made(
            lambda: time.monotonic() - start,
            field_gauss=(0.1 * (number + 1), -0.05 * (number + 1), 0.3),
            clock_error=(number - 1.5) * 0.02,
            phase_s=0.001 * number,
            address=addresses[number] if addresses else None,
        )
        for number in range(len(addresses) or 4)
    ]
    return Bus([], chips) if addresses else Bus([Tca9548a(0x70, dict(enumerate(chips)))])


main()
