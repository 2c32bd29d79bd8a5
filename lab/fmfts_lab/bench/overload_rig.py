"""The processes of the overload bench: boards that note when they wrote each frame, busy processes, and subscribers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np
import zmq
from msgspec.structs import replace
from numpy.typing import NDArray

from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import Sample
from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.latency import pad_of
from fmfts_simulation.finger import Finger, Touch
from fmfts_simulation.source import Simulated

Times = NDArray[np.int64]

# Boards and subscriber stand for other computers: they get priority over the daemon, so that any delay is the daemon's.
OTHERS_PRIORITY = 50
# Before the load, and after it. Python judges the first frames of each pad, and is behind for two seconds with 64.
WARM_UP_S, AFTER_S = 4.0, 3.0
DUTY_PERIOD_S = 0.1
# Boards write in this many groups, and the subscriber polls at this interval: waking up for each frame takes half a
# core.
PHASES = 12
LOOK_S = 0.002


@dataclass(frozen=True)
class Load:
    """busy: processes that only compute. duty: the share of time in which the measured process may run. disturbed:
    after a second, steel is beside every pad.
    """

    pads: int
    busy: int = 0
    duty: float = 1.0
    realtime: int = 0
    touched: bool = False
    disturbed: bool = False

    def __str__(self) -> str:
        extra = [f"{self.busy} busy"]
        extra += [f"own duty {100 * self.duty:.0f} %"] * (self.duty < 1.0)
        extra += [f"realtime {self.realtime}"] * (self.realtime > 0)
        extra += ["half of the pads touched"] * self.touched
        extra += ["steel beside each"] * self.disturbed
        return f"{self.pads} pads, {', '.join(extra)}"


@dataclass(frozen=True)
class Written:
    """When each frame was handed to its pty, and when it was due, which is the time that the frame states: written_ns,
    due_ns (pads, frames). A board that the computer held up is late, and its clock is not. lost: frames that found no
    room.
    """

    written_ns: Times
    due_ns: Times
    lost: NDArray[np.bool_]
    load_ns: tuple[int, int]


def recordings(load: Load, seconds: float) -> list[list[bytes]]:
    """The lines of each pad: untouched, or for half of the pads touched and released at random."""
    quiet = lines(lambda _: Touch(0.0, 0.0, 0.0), seconds, load.disturbed)
    if not load.touched:
        return [quiet] * load.pads
    tapped = [lines(random_finger(seed), seconds) for seed in range(8)]
    return [tapped[pad // 2 % len(tapped)] if pad % 2 else quiet for pad in range(load.pads)]


def lines(finger: Finger, seconds: float, is_disturbed: bool = False) -> list[bytes]:
    """What a board sends, with the frame's number as its temperature (latency_rig.NUMBERS)."""
    source = Simulated(pad_of(0))
    source.finger = finger
    samples = rig.samples_of(source, seconds)
    return [
        encode(sample if number < rig.RATE_HZ or not is_disturbed else beside_steel(sample))
        for number, sample in enumerate(samples)
    ]


def beside_steel(sample: Sample) -> Sample:
    """The sample with a field that no finger causes."""
    counts = sample.counts.copy()
    counts[:, 2] += np.array([300, -200, 250, -350], dtype=np.int16)
    return replace(sample, counts=counts)


def random_finger(seed: int) -> Finger:
    """Presses of 0.1 to 0.5 s and pauses of the same length, with ramps of 30 ms, anywhere within 6 mm."""
    draw = np.random.default_rng(seed)
    edges = np.cumsum(draw.uniform(0.1, 0.5, 400)) + 0.5
    places, forces = draw.uniform(-6e-3, 6e-3, (400, 2)), draw.uniform(0.3, 1.5, 400)

    def finger(time_s: float) -> Touch:
        index = int(np.searchsorted(edges, time_s))
        if index % 2 == 0 or index >= len(edges):
            return Touch(0.0, 0.0, 0.0)
        from_edge = min(time_s - edges[index - 1], edges[index] - time_s)
        x_m, y_m = places[index].tolist()
        return Touch(x_m, y_m, float(forces[index] * min(from_edge / 0.03, 1.0)))

    return finger


def boards(pipe: Connection, recorded: list[list[bytes]], load_s: float) -> None:
    """Boards that begin one after the other within a frame's time. Sends the ports, waits for "go", sends the load's
    begin and end, and last the times (pads, frames) of Written with what was lost."""
    ends, answers = rig.ptys(len(recorded))
    pipe.send([os.ttyname(theirs) for _, theirs in ends])
    while not pipe.poll(0.02):
        rig.answer(answers)
    pipe.recv()
    go_first()
    count, frames = len(recorded), len(recorded[0])
    written_ns, dues_ns = np.zeros((2, count, frames), dtype=np.int64)
    lost = np.zeros((count, frames), dtype=np.bool_)
    period_ns, start_ns = 1e9 / rig.RATE_HZ, time.monotonic_ns() + 50_000_000
    begin_ns = start_ns + round(WARM_UP_S * 1e9)
    pipe.send((begin_ns, begin_ns + round(load_s * 1e9)))
    for number in range(frames):
        for pad, (ours, _) in enumerate(ends):
            due_ns = start_ns + round((number + pad * PHASES // count / PHASES) * period_ns)
            dues_ns[pad, number] = due_ns
            if (left_ns := due_ns - time.monotonic_ns()) > 0:
                time.sleep(left_ns * 1e-9)
            written_ns[pad, number] = time.monotonic_ns()
            try:
                os.write(ours, recorded[pad][number])
            except BlockingIOError:
                lost[pad, number] = True
        if number % 50 == 0:
            rig.answer(answers)
    pipe.send((written_ns, dues_ns, lost))
    pipe.recv()


def subscriber(pipe: Connection, endpoint: str, count: int) -> None:
    """As latency_rig.subscriber, but looks only every LOOK_S."""
    go_first()
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, 0)
    socket.connect(endpoint)
    socket.subscribe(b"contact/")
    heard: set[bytes] = set()
    messages: list[tuple[bytes, int, bytes]] = []
    while not pipe.poll(0):
        time.sleep(LOOK_S)
        now_ns = time.monotonic_ns()
        with suppress(zmq.Again):
            while True:
                topic, payload = socket.recv_multipart(zmq.NOBLOCK)
                messages.append((topic, now_ns, payload))
        if len(heard) < count:
            heard |= {topic for topic, _, _ in messages}
            messages.clear()
            if len(heard) == count:
                pipe.send("ready")
    pipe.send(messages)


def go_first() -> None:
    """Runs before every ordinary process. Where that is not permitted, the busy processes delay the boards, too."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(OTHERS_PRIORITY))
    except PermissionError:
        print("boards and subscriber get no priority: what is late may be theirs", file=sys.stderr)


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Processes that never sleep, with the measured process's weight."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def hold_to(duty: float, pid: int, until_ns: int) -> None:
    """Until then, let a process run only for this share of each DUTY_PERIOD_S."""
    while (now_ns := time.monotonic_ns()) < until_ns:
        if duty < 1.0:
            os.kill(pid, signal.SIGSTOP)
            time.sleep(DUTY_PERIOD_S * (1.0 - duty))
            os.kill(pid, signal.SIGCONT)
            time.sleep(DUTY_PERIOD_S * duty)
        else:
            time.sleep((until_ns - now_ns) * 1e-9)


def sleep_until(when_ns: int) -> None:
    time.sleep(max(when_ns - time.monotonic_ns(), 0) * 1e-9)


Start = Callable[[Sequence[str]], int]
