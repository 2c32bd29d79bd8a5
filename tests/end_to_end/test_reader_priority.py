"""`[service] realtime_priority` and the process that reads an I2C bus: real processes and the real scheduler."""

from __future__ import annotations

import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

import permitted
from end_to_end.kernel_bus import PATIENCE_S, KernelBus, kernel_bus, pad
from end_to_end.processes import RunningDaemon
from fmfts.sensor.i2c.bus import CallRecord
from fmfts.sensor.i2c.reader_config import reader_config
from fmfts.sensor.wire.framing import Decoder
from fmfts.sensor.wire.packets import Sample
from fmfts.sources import on_i2c

PRIORITY = 3
FIRST = (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, PRIORITY)
ORDINARY = (os.SCHED_OTHER, 0)
CONFIG = """
[service]
realtime_priority = {priority}
[[pad]]
name = "left"
[pad.source]
type = "i2c"
bus = 7
rate_hz = 75
"""
CAN_GIVE_IT_UP = permitted.another_user() and shutil.which("setpriv") is not None
WITHOUT_THE_RIGHT = ("setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice", "prlimit", "--rtprio=0:0")


needs_the_right = pytest.mark.skipif(not permitted.priority(), reason=permitted.NO_PRIORITY)


@pytest.fixture
def kernel() -> Iterator[KernelBus]:
    with kernel_bus() as bus:
        yield bus


def scheduling(process: int) -> tuple[int, int]:
    return os.sched_getscheduler(process), os.sched_getparam(process).sched_priority


def reader_of(daemon: RunningDaemon, other_than: int = 0) -> int:
    """The daemon's child that reads the bus, once all sensors are read."""
    daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
    listed = Path(f"/proc/{daemon.process.pid}/task/{daemon.process.pid}/children").read_text().split()
    (reader,) = [
        int(child) for child in listed if b"fmfts.sensor.i2c.reader" in Path(f"/proc/{child}/cmdline").read_bytes()
    ]
    assert reader != other_than
    return reader


@needs_the_right
def test_reader_and_its_successor_have_the_loops_priority(kernel: KernelBus, tmp_path: Path) -> None:
    with RunningDaemon(tmp_path, CONFIG.format(priority=PRIORITY)) as daemon:
        reader = reader_of(daemon)
        assert scheduling(daemon.process.pid) == FIRST
        assert scheduling(reader) == FIRST
        daemon.wait_for(lambda contact: contact.health == "disconnected", act=lambda: os.kill(reader, 9))
        assert scheduling(reader_of(daemon, other_than=reader)) == FIRST


def test_reader_of_an_ordinary_daemon_is_ordinary(kernel: KernelBus, tmp_path: Path) -> None:
    with RunningDaemon(tmp_path, CONFIG.format(priority=0)) as daemon:
        assert scheduling(reader_of(daemon)) == ORDINARY


@pytest.mark.skipif(not permitted.locked_memory(), reason=permitted.NO_LOCKED_MEMORY)
def test_reader_locks_its_memory_as_the_daemon_does(kernel: KernelBus, tmp_path: Path) -> None:
    config = CONFIG.format(priority=0).replace("[service]", "[service]\nlock_memory = true")
    with RunningDaemon(tmp_path, config) as daemon:
        assert locked_kb(reader_of(daemon)) > 0


def test_i2c_reader_locks_memory_only_if_daemon_does(kernel: KernelBus, tmp_path: Path) -> None:
    with RunningDaemon(tmp_path, CONFIG.format(priority=0)) as daemon:
        assert locked_kb(reader_of(daemon)) == 0


def locked_kb(process: int) -> int:
    status = Path(f"/proc/{process}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmLck:"))


@pytest.mark.skipif(not CAN_GIVE_IT_UP, reason="needs root and setpriv, to give the right up")
def test_i2c_reader_without_priority_reports_it_and_reads(kernel: KernelBus) -> None:
    config = msgspec.structs.replace(reader_config({0: on_i2c(pad())}), realtime_priority=PRIORITY)
    record = CallRecord()
    reader = subprocess.Popen(
        [*WITHOUT_THE_RIGHT, sys.executable, "-m", "fmfts.sensor.i2c.reader", str(record.descriptor), _json(config)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        pass_fds=[record.descriptor],
    )
    try:
        assert reader.stdout is not None
        samples = _samples(reader.stdout.fileno(), 5)
        assert scheduling(reader.pid) == ORDINARY
    finally:
        _, said = reader.communicate(timeout=PATIENCE_S)
        record.close()
    assert len(samples) >= 5
    assert "the reader of I2C bus 7 may be late on a busy computer" in said.decode()
    assert f"LimitRTPRIO={PRIORITY}" in said.decode()


def _json(config: object) -> str:
    return msgspec.json.encode(config).decode()


def _samples(descriptor: int, wanted: int) -> list[Sample]:
    decoder, samples, until = Decoder(), list[Sample](), time.monotonic() + PATIENCE_S
    while len(samples) < wanted:
        assert select.select([descriptor], [], [], max(0.0, until - time.monotonic()))[0], "the reader is silent"
        data = os.read(descriptor, 65536)
        assert data, "the reader ended"
        samples += [packet for packet in decoder.feed(data) if isinstance(packet, Sample)]
    return samples
