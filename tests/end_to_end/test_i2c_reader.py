"""The process that reads an I2C bus: a bus that hangs, is taken or absent, its own death, and its refusals."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator

import pytest

from end_to_end.kernel_bus import PATIENCE_S, KernelBus, all_valid, kernel_bus, pad, run
from fmfts.sensor import Frame
from fmfts.sensor.i2c.source import I2c
from fmfts.sources import on_i2c


@pytest.fixture
def kernel() -> Iterator[KernelBus]:
    with kernel_bus() as bus:
        yield bus


def test_mux_bound_by_the_kernel_is_named(kernel: KernelBus) -> None:
    kernel.order(busy=[0x70])
    source = kernel.open(pad())
    run(source, lambda frames: "bound by the kernel" in source.state.reason)
    assert "0x70 on /dev/i2c-7 is bound by the kernel:" in source.state.reason
    kernel.order(busy=[])
    run(source, all_valid)


@pytest.mark.real_time
def test_wedged_bus_blocks_no_pad_names_call_and_recovers(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)
    kernel.order(block_s=60)
    longest_s = 0.0
    end = time.monotonic() + PATIENCE_S
    while "wedged" not in source.state.reason:
        assert time.monotonic() < end
        start = time.monotonic()
        source.poll(time.monotonic_ns())
        longest_s = max(longest_s, time.monotonic() - start)
        time.sleep(0.002)
    assert longest_s < 0.5  # a poll on a busy machine, against sixty seconds of the call
    assert not source.state.connected
    assert re.search(r"/dev/i2c-7 is wedged for [0-3]\.", source.state.reason)  # of sixty; a busy poll may come late
    assert "(mux 0x70, channels 0b" in source.state.reason
    kernel.order(block_s=0)
    run(source, all_valid)
    assert source.state.reconnects == 1


@pytest.mark.real_time  # a reader that a busy computer delays for long is distinguished from one that works
def test_reader_that_dies_is_started_again(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)
    source._process.kill()
    run(source, lambda frames: not source.state.connected)
    assert source.state.reason == "its reader ended with code -9"
    run(source, all_valid)
    assert source.state.reconnects == 1


def test_killed_readers_last_line_is_not_given_as_the_cause(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)

    def complained(_: list[Frame]) -> bool:
        kernel.order(mux=0, set={"control": 0x80, "pending": 0x80})
        return "another program uses the mux" in source.state.warnings.get("bus", "")

    run(source, complained)
    source._process.kill()
    run(source, lambda frames: not source.state.connected)
    assert source.state.reason == "its reader ended with code -9"


def test_second_reader_is_refused_with_the_firsts_pid(kernel: KernelBus) -> None:
    first, second = kernel.open(pad()), kernel.open(pad())
    run(first, all_valid)
    run(second, lambda frames: "in use" in second.state.reason)
    assert f"/dev/i2c-7 is in use by process {first._process.pid} (" in second.state.reason
    first.close()
    run(second, all_valid)


def test_bus_that_is_absent_is_named(kernel: KernelBus) -> None:
    source = kernel.open(pad(bus=6))
    run(source, lambda frames: "/dev/i2c-6 does not exist" in source.state.reason)


def test_closing_ends_the_reader(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)
    pid = source._process.pid
    source.close()
    source.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_three_pads_fit_on_one_bus_at_220_hz() -> None:
    I2c({index: on_i2c(pad(f"pad{index}", rate_hz=220, mux_address=0x70 + index)) for index in range(3)}).close()
