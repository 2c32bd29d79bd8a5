"""`make failing-source`: a source that raises or returns anything, beside three healthy pads of one daemon.

The daemon is the real one, in a process of its own, and so is the subscriber. If permitted, it runs before other
programs, as the service does, and so does a metronome. Each kind of fault lasts `--seconds`; the seed decides at which
call of the source it comes. Then the cause goes, and the pad must come back by itself.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from multiprocessing.sharedctypes import Synchronized
from random import Random
from typing import Any
from unittest.mock import patch

import msgspec
import zmq

import permitted
from faulty_source import HARMLESS, KINDS, Faulty
from fmfts.config import BusConfig, Config, PadConfig, ServiceConfig, SimulatedSource
from fmfts.service.realtime import take_thread_priority
from fmfts_simulation.source import CATCH_UP_FRAMES

HEALTHY, RATE_HZ, NONE = ("a", "b", "c"), 220, -1
PATIENCE_S = 30.0
PRIORITY = 20 if permitted.priority() else 0
PUBLISHED = 0.999
UNDER_WAY_S = 0.2  # a message may take this long


def pad(name: str) -> PadConfig:
    return PadConfig(name=name, source=SimulatedSource(finger="none", rate_hz=RATE_HZ))


def daemon(folder: str, kind: Synchronized[int], seed: int) -> None:
    os.environ |= {"XDG_STATE_HOME": folder, "FMFTS_BUS": f"ipc://{folder}"}
    from fmfts.runtime import daemon as running
    from fmfts.sources import Device, devices

    def fault() -> tuple[str, str] | None:
        return None if kind.value == NONE else KINDS[kind.value]

    faulty = Device({0: "faulty"}, partial(Faulty, pad("faulty"), fault, Random(seed), 0.02), "a plug-in")
    service = ServiceConfig(realtime_priority=PRIORITY)
    settings = Config(tuple(map(pad, ("faulty", *HEALTHY))), BusConfig(endpoint=f"ipc://{folder}"), service=service)
    with (
        patch.object(running, "devices", lambda pads: [*devices(pads[1:]), faulty]),
        running.Daemon(settings) as one_daemon,
    ):
        one_daemon.run()


def metronome(missed: Synchronized[int], priority: int) -> None:
    """A process that only ticks, as often as all healthy pads: ticks that it misses are this computer's fault.

    Like a simulated pad it makes up for the last CATCH_UP_FRAMES ticks.
    """
    if priority:
        take_thread_priority(priority)
    begun, ticks = time.monotonic(), 0
    while True:
        ticks += 1
        time.sleep(max(begun + ticks / RATE_HZ - time.monotonic(), 0.0))
        late = int((time.monotonic() - begun) * RATE_HZ) - ticks + 1 - CATCH_UP_FRAMES
        if late > 0:
            ticks += late
            missed.value += late


@dataclass
class Heard:
    """For one kind of fault: sample times (ns) of the healthy pads, and the messages of the faulty pad.

    spans_ns: the time in which each pad's samples are due.
    """

    ok_ns: dict[str, list[int]] = field(default_factory=lambda: {name: [] for name in HEALTHY})
    spans_ns: list[tuple[int, int]] = field(default_factory=list)
    not_ok: int = 0
    reasons: list[str] = field(default_factory=list)
    failures: int = 0
    last: str = ""
    missed: int = 0  # ticks of the metronome

    def take(self, topic: bytes, body: dict[str, Any]) -> None:
        if topic.startswith(b"event/"):
            self.failures += body["kind"] == "health" and body["detail"].startswith("disconnected")
        elif body["pad"] == "faulty":
            self.last = body["health"]
            if body["reason"] and (not self.reasons or body["reason"] != self.reasons[-1]):
                self.reasons.append(body["reason"])
        elif body["health"] == "ok":
            self.ok_ns[body["pad"]].append(body["t_sample_ns"])
        else:
            self.not_ok += 1

    @property
    def due(self) -> int:
        """Frames of one healthy pad."""
        return max(int(sum(end - begin for begin, end in self.spans_ns) * 1e-9 * RATE_HZ), 1)

    @property
    def published(self) -> float:
        """The smallest share of published frames of any healthy pad."""
        on_time = (
            sum(begin <= at < end for begin, end in self.spans_ns for at in times) for times in self.ok_ns.values()
        )
        return min(on_time) / self.due

    @property
    def possible(self) -> float:
        """Share of the ticks that came in time in a process with nothing else to do."""
        return 1.0 - self.missed / self.due


class Ear:
    """Receives everything that the daemon publishes."""

    def __init__(self, folder: str) -> None:
        self._socket = zmq.Context.instance().socket(zmq.SUB)
        self._socket.setsockopt(zmq.RCVHWM, 0)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.connect(f"ipc://{folder}/bus")
        for topic in (b"contact/", b"event/faulty"):
            self._socket.subscribe(topic)

    def listen(self, heard: Heard, until: Callable[[], bool], patience_s: float) -> float:
        """Seconds until `until` holds, or patience_s."""
        begun = time.monotonic()
        while (lasted := time.monotonic() - begun) < patience_s and not until():
            if self._socket.poll(100):
                topic, payload = self._socket.recv_multipart()
                heard.take(topic, msgspec.msgpack.decode(payload))
        return lasted

    def await_last(self, heard: Heard, begun_ns: int) -> None:
        """End a phase that began at begun_ns: wait for the last messages of it."""
        heard.spans_ns.append((begun_ns, time.monotonic_ns()))
        self.listen(heard, lambda: False, UNDER_WAY_S)


def main() -> int:
    """Exit code 1 if a healthy pad lost frames, or the failing one did not say why, or did not come back."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0, help="how long each kind of fault lasts")
    parser.add_argument("--only", default="", help="kinds of faults that have this in their names")
    parser.add_argument("--seed", type=int, default=40)
    options = parser.parse_args()
    spawn = get_context("spawn")
    kind, missed, failed = spawn.Value("i", NONE), spawn.Value("i", 0), 0
    with tempfile.TemporaryDirectory() as folder:
        process = spawn.Process(target=daemon, args=(folder, kind, options.seed))
        process.start()
        beside = spawn.Process(target=metronome, args=(missed, PRIORITY), daemon=True)
        beside.start()
        ear, calm, whole = Ear(folder), Heard(), Heard()
        if ear.listen(calm, lambda: calm.last == "ok" and all(calm.ok_ns.values()), PATIENCE_S) >= PATIENCE_S:
            process.terminate()
            sys.exit(f"within {PATIENCE_S:g} s not every pad was ok")
        calm, begun_ns = Heard(), time.monotonic_ns()
        ear.listen(calm, lambda: False, 5.0)
        ear.await_last(calm, begun_ns)
        print(
            f"without a fault: {calm.published:.3%} of the frames are published, of the healthy pad that has the fewest"
        )
        print(f"{'fault':32}{'published':>10}{'possible':>10}{'failures':>10}{'back after':>12}  reason")
        for number, (what, name) in enumerate(KINDS):
            if options.only not in f"{what} {name}":
                continue
            during, before, begun_ns = Heard(), missed.value, time.monotonic_ns()
            kind.value = number
            ear.listen(during, lambda: False, options.seconds)
            kind.value = NONE
            during.last = ""
            back_s = ear.listen(during, lambda during=during: during.last == "ok", PATIENCE_S)
            ear.await_last(during, begun_ns)
            during.missed = missed.value - before
            whole.missed += during.missed
            reason = max(during.reasons, key=len, default="")
            good = back_s < PATIENCE_S and (bool(reason) or (what, name) in HARMLESS) and during.not_ok == 0
            good = good and all(during.ok_ns.values())
            failed += not good
            for name_of_pad, times in during.ok_ns.items():
                whole.ok_ns[name_of_pad] += times
            whole.spans_ns += during.spans_ns
            told = reason.removeprefix("simulated pad, seed 1: ")[:70]
            shares = f"{during.published:10.3%}{during.possible:10.3%}"
            verdict = "" if good else "  FAILED"
            print(f"{what + ' ' + name:32}{shares}{during.failures:10}{back_s:10.2f} s  {told}{verdict}", flush=True)
        alive = process.is_alive()
        process.terminate()
        process.join(10.0)
        beside.terminate()
    print(
        f"{'all':32}{whole.published:10.3%}{whole.possible:10.3%}   the daemon {'ran to the end' if alive else 'ENDED'}"
    )
    return int(failed > 0 or not alive or whole.published < PUBLISHED * whole.possible)


if __name__ == "__main__":
    sys.exit(main())
