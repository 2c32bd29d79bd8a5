"""A daemon with many pads of four magnets: the processor time that it takes, and whether it keeps up.

The daemon is the real one, in a process of its own, with its loop, its publisher and a subscriber. Only its sources are
others: they hand out frames that were simulated before, each when it is due, because simulating a frame takes longer
than judging it. The time of handing out is measured separately, and reported.
"""

from __future__ import annotations

import os
import tempfile
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.connection import Connection
from typing import Any
from unittest.mock import patch

import msgspec
import numpy as np
import zmq

from fmfts.config import BusConfig, Config, PadConfig, SimulatedSource
from fmfts.sensor import Frame
from fmfts.sensor.source import CannotError, SourceState
from fmfts.sources import Device
from fmfts_lab.bench.latency import cpu_by_thread, spawn
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.array import SimulatedArray

RATE_HZ, SEEDS, WARM_UP_S = 220, 2, 2.0
LONGEST_LAP_S = 10.0  # after that the same frames repeat
PATIENCE_S = 300.0  # for the frames, and for the first contact


@dataclass(eq=False)
class Prepared:
    """A Source whose frames were made before. They begin with the first poll, and again when they are over."""

    frames: Sequence[Frame]
    state: SourceState = field(default_factory=lambda: SourceState("prepared frames"))
    start_ns: int | None = None
    next: int = 0

    def fileno(self) -> None:
        return None

    def deadline_ns(self) -> int:
        return 0 if self.start_ns is None else self.start_ns + self.next * 1_000_000_000 // RATE_HZ

    def poll(self, now_ns: int) -> list[Frame]:
        if self.start_ns is None:
            self.start_ns = now_ns
            self.state.connect(now_ns)
        due = []
        while self.deadline_ns() <= now_ns:
            lap, number = divmod(self.next, len(self.frames))
            later_us = lap * len(self.frames) * 1_000_000 // RATE_HZ
            one = self.frames[number]
            due.append(
                replace(
                    one,
                    sequence=self.next,
                    device_time_us=one.device_time_us + later_us,
                    host_time_ns=self.start_ns + one.host_time_ns + later_us * 1000,
                )
            )
            self.next += 1
        return due

    def request_selftest(self, pad_index: int) -> None:
        raise CannotError("prepared frames have no chips")

    def selftest_result(self, pad_index: int) -> None:
        return None

    def close(self) -> None:
        self.state.disconnect("closed", time.monotonic_ns())


def config_of(number: int) -> PadConfig:
    """Every other pad has two fingers that meet and part; the others have none."""
    config = array_config(f"p{number}", seed=1 + number // 2 % SEEDS, fingers=2 if number % 2 else 1)
    assert isinstance(config.source, SimulatedSource)
    if number % 2:
        return config
    return msgspec.structs.replace(config, source=msgspec.structs.replace(config.source, finger="none"))


def frames_of(config: PadConfig, seconds: float) -> list[Frame]:
    source = SimulatedArray(config)
    steps = round(seconds * RATE_HZ)
    return [frame for step in range(steps) for frame in source.poll(-(-step * 1_000_000_000 // RATE_HZ))]


def daemon(pipe: Connection, folder: str, pads: int, seconds: float) -> None:
    """The process that is measured. Sends the processor time (s) of handing out all frames, then runs until SIGTERM."""
    os.environ |= {"XDG_STATE_HOME": folder, "FMFTS_BUS": f"ipc://{folder}"}
    from fmfts.runtime import daemon as running

    configs = [config_of(number) for number in range(pads)]
    made = {str(one.source): frames_of(one, seconds) for one in configs[: 2 * SEEDS]}
    began = time.process_time()
    for one in configs:
        handed = Prepared(made[str(one.source)])
        for number in range(len(handed.frames)):
            handed.deadline_ns()
            handed.poll(round(number * 1e9 / RATE_HZ))
    pipe.send(time.process_time() - began)
    prepared = [Device({0: one.name}, partial(Prepared, made[str(one.source)]), one.name) for one in configs]
    settings = Config(tuple(configs), BusConfig(endpoint=f"ipc://{folder}"))
    with patch.object(running, "devices", lambda *_: prepared), running.Daemon(settings) as one_daemon:
        one_daemon.run()


@dataclass
class Heard:
    """The messages of a period: contacts by health and by number of fingers, and their ages.

    numbers, dropped: of each pad, its first and its last number of a contact, and of frames that were left out.
    """

    health: Counter[str] = field(default_factory=Counter)
    fingers: Counter[str] = field(default_factory=Counter)
    age_ns: list[int] = field(default_factory=list)
    numbers: dict[str, list[int]] = field(default_factory=dict)
    dropped: dict[str, list[int]] = field(default_factory=dict)

    def contact(self, told: dict[str, Any]) -> None:
        self.health[told["health"]] += 1
        self.fingers["none told" if told["contacts"] is None else str(len(told["contacts"]))] += 1
        self.age_ns.append(told["t_publish_ns"] - told["t_sample_ns"])
        self.numbers.setdefault(told["pad"], [told["seq"]]).append(told["seq"])

    @property
    def left_out(self) -> int:
        """Frames that were not published: before they were judged, by the statuses, and after, by the numbers."""
        before = sum(each[-1] - each[0] for each in self.dropped.values())
        return before + sum(each[-1] - each[0] + 2 - len(each) for each in self.numbers.values())


def hear(socket: zmq.Socket[bytes], seconds: float) -> Heard:
    heard, until_s = Heard(), time.monotonic() + seconds
    while (left_s := until_s - time.monotonic()) > 0.0:
        if socket.poll(max(1, round(left_s * 1e3))):
            topic, payload = socket.recv_multipart()
            told = msgspec.msgpack.decode(payload)
            if topic.startswith(b"contact/"):
                heard.contact(told)
            elif topic.startswith(b"status/"):
                heard.dropped.setdefault(told["pad"], []).append(told["dropped"])
    return heard


def run(options: Namespace) -> None:
    """Print the row. SystemExit where not every pad is heard."""
    pads, lap_s = options.running, min(options.seconds, LONGEST_LAP_S)
    with tempfile.TemporaryDirectory(prefix="fmfts-several-") as folder:
        pipe, process = spawn(daemon, folder, pads, lap_s)
        socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
        socket.setsockopt(zmq.RCVHWM, 0)
        socket.connect(f"ipc://{folder}/bus")
        socket.subscribe(b"")
        try:
            if not pipe.poll(PATIENCE_S):
                raise SystemExit(f"the frames were not made within {PATIENCE_S:.0f} s: is the computer that busy?")
            handing_us = pipe.recv() / (pads * lap_s * RATE_HZ) * 1e6
            if not socket.poll(round(PATIENCE_S * 1e3)):
                raise SystemExit(f"the daemon published nothing within {PATIENCE_S:.0f} s")
            hear(socket, WARM_UP_S)
            before, begun_s = np.array(cpu_by_thread(process.pid)), time.monotonic()
            heard = hear(socket, options.seconds)
            taken_s = time.monotonic() - begun_s
            main, others = ((np.array(cpu_by_thread(process.pid)) - before) * 1e-9 / taken_s).tolist()
        finally:
            process.terminate()
            process.join(20)
            socket.close()
    if len(heard.numbers) < pads:
        raise SystemExit(f"only {len(heard.numbers)} of {pads} pads were heard")
    rate_hz, ages_ms = len(heard.age_ns) / taken_s, np.percentile(heard.age_ns, [50, 99, 100]) * 1e-6
    print(
        "| pads | main thread, % of a core | of it handing out frames | other threads | main thread, µs a frame "
        "| published, Hz a pad | left out | age of samples: median, p99, worst ms | health | fingers |\n"
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
        f"| {pads} | {main:.1%} | {handing_us * 1e-6 * RATE_HZ * pads:.1%} | {others:.1%} | {main / rate_hz * 1e6:.0f} "
        f"| {rate_hz / pads:.1f} | {heard.left_out} of {len(heard.age_ns) + heard.left_out} "
        f"| {', '.join(f'{age:.1f}' for age in ages_ms)} | {_shares(heard.health)} | {_shares(heard.fingers)} |\n\n"
        f"load of the computer: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )


def _shares(counts: Counter[str]) -> str:
    return ", ".join(f"{name} {count / counts.total():.2%}" for name, count in counts.most_common())
