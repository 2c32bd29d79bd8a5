"""Emulated I2C buses for real smbus2 clients under umockdev's preload: /dev/i2c-7 with two muxes of four HMC5983 each,
and /dev/i2c-8, which no command affects, with one.

With a kind of chip as its argument, /dev/i2c-7 has such chips instead: four behind one mux ("qmc5883l"), or one at each
address that follows, without a mux ("mlx90393 12 13 14 15"). With "wide" its two muxes have eight HMC5983 each.

"--adapter KIND" says which adapter of i2c_adapters.py both buses are on: "bcm2835", which refuses the most of those on
a board, without it. Its refusals, reports and delays, its sysfs files, and its answer to I2C_FUNCS follow.

Run by the system's Python (it needs gir1.2-umockdev-1.0). Prints the test bed's directory, then obeys one JSON object
a line on stdin and prints "done" after each:
    {"chip": [mux, channel], "set": {...}}   attributes of a chip        {"mux": mux, "set": {...}}   of a mux
    {"chip": [mux, channel], "call": "power_on"}                         {"busy": [addresses]}  kernel-bound
    {"block_s": seconds}                     every transfer from now on takes that long
    {"errno": number}                        every transfer from now on fails with it; 0: none
    {"direct": index, "set": {...}}          attributes of a chip without a mux
    {"report": true}                         prints transfers, conflicts and registers instead of "done"
"""

from __future__ import annotations

import argparse
import errno
import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from struct import Struct

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))
import magnetometers  # noqa: E402
from chips import Bus, Hmc5983, NackError, Tca9548a  # noqa: E402
from i2c_adapters import ADAPTERS, Adapter, Message  # noqa: E402
from mlx90393 import Mlx90393  # noqa: E402

I2C_SLAVE, I2C_FUNCS, I2C_RDWR, I2C_SMBUS = 0x0703, 0x0705, 0x0707, 0x0720
# The controller, its adapter, and its device node: as sysfs has them.
DEVICES = """\
P: /devices/{device}
E: SUBSYSTEM=platform
L: driver=/sys/bus/drivers/{driver}
{clock}
P: /devices/{device}/i2c-{number}
E: SUBSYSTEM=i2c
A: name={name}\\n

P: /devices/{device}/i2c-{number}/i2c-dev/i2c-{number}
N: i2c-{number}
E: DEVNAME=/dev/i2c-{number}
E: SUBSYSTEM=i2c-dev
"""
MUXES = {7: 2, 8: 1}  # by bus
POINTER = 8  # bytes on a 64-bit kernel
HEADER = Struct("<HHHxxQ")  # struct i2c_msg: address, flags, length, and the pointer to its bytes
MESSAGE = HEADER.size


class KernelBus(UMockdev.IoctlBase):
    def __init__(self, bus: Bus, adapter: Adapter) -> None:
        super().__init__()
        self.bus = bus
        self.adapter = adapter
        self.block_s = self.took_s = 0.0
        self.errno = 0
        self.busy: list[int] = []
        self.slave = 0
        self.muxes_written_by_others = 0

    def do_handle_ioctl(self, client: UMockdev.IoctlClient) -> bool:
        self.took_s = 0.0
        handler = {I2C_SLAVE: self._slave, I2C_FUNCS: self._funcs, I2C_RDWR: self._rdwr, I2C_SMBUS: self._smbus}
        try:
            result, error = handler[client.get_request()](client.get_arg()), 0
        except NackError:
            result, error = -1, self.adapter.no_answer
        except OSError as failure:
            result, error = -1, failure.errno
        except GLib.Error:  # the client was killed in the middle of its call
            return True
        if self.block_s and client.get_request() in (I2C_RDWR, I2C_SMBUS):
            GLib.timeout_add(int(1000 * self.block_s), lambda: client.complete(-1, errno.ETIMEDOUT))
        elif self.took_s:
            GLib.timeout_add(int(1000 * self.took_s), lambda: client.complete(result, error))
        else:
            client.complete(result, error)
        return True

    def _slave(self, argument: UMockdev.IoctlData) -> int:
        self.slave = _number(argument, 0, POINTER)
        if self.slave in self.busy:
            raise OSError(errno.EBUSY, "")
        return 0

    def _funcs(self, argument: UMockdev.IoctlData) -> int:
        argument.resolve(0, POINTER).update(0, list(self.adapter.functions.to_bytes(POINTER, "little")))
        return 0

    def _rdwr(self, argument: UMockdev.IoctlData) -> int:
        request = argument.resolve(0, 2 * POINTER)
        count = _number(request, POINTER, 4)
        table = request.resolve(0, MESSAGE * count)
        headers = list(HEADER.iter_unpack(bytes(table.retrieve())))
        buffers = [table.resolve(MESSAGE * place + 8, size) for place, (_, _, size, _) in enumerate(headers)]
        seen = [Message(*header[:3]) for header in headers]
        refused = self.errno or self.adapter.refusal(seen)
        if refused:
            raise OSError(refused, "")
        self.took_s = self.adapter.took_s(seen)
        messages = [
            (one.address, one.size if one.reads else bytes(buffer.retrieve()))
            for one, buffer in zip(seen, buffers, strict=True)
        ]
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
    kernel.errno = order.get("errno", kernel.errno)
    if "report" in order:
        chips = [chip for mux in kernel.bus.muxes for chip in mux.channels.values()] + list(kernel.bus.chips)
        registers = [list(chip.registers[:3]) for chip in chips]
        conflicts = kernel.bus.conflicts
        return json.dumps({"transfers": kernel.bus.transfers, "conflicts": conflicts, "registers": registers})
    return "done"


def main() -> None:
    with suppress(PermissionError):  # chips need no processor time; without the right to this they do when it is busy
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    parser = argparse.ArgumentParser()
    parser.add_argument("--adapter", choices=ADAPTERS, default="bcm2835")
    parser.add_argument("--clock-hz", type=int, default=None)
    parser.add_argument("chip", nargs="?")
    parser.add_argument("addresses", nargs="*", type=int)
    options = parser.parse_args()
    adapter = ADAPTERS[options.adapter]
    testbed = UMockdev.Testbed.new()
    buses = {number: Bus(some_muxes(count)) for number, count in MUXES.items()}
    if options.chip == "wide":
        buses[7] = Bus(some_muxes(MUXES[7], 8))
    elif options.chip is not None:
        buses[7] = bus_of(options.chip, options.addresses)
    kernels = {number: KernelBus(bus, adapter) for number, bus in buses.items()}
    for number, kernel in kernels.items():
        testbed.add_from_string(devices(adapter, number, options.clock_hz or adapter.clock_hz))
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


def devices(adapter: Adapter, number: int, clock_hz: int | None) -> str:
    """For umockdev. The second bus is on a controller of its own."""
    return DEVICES.format(
        device=adapter.device if number == 7 else f"{adapter.device}.{number}",
        driver=adapter.driver,
        name=adapter.name,
        number=number,
        clock="" if clock_hz is None else f"H: of_node/clock-frequency={clock_hz:08X}\n",
    )


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
    known = {"hmc5983": Hmc5983, "hmc5883l": Hmc5983, "mlx90393": Mlx90393}
    made = (known | {name.lower(): each for name, each in vars(magnetometers).items() if isinstance(each, type)})[kind]
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
