"""The processes around the daemon when its latency is measured: boards on ptys, echo, subscriber."""

from __future__ import annotations

import os
import select
import struct
import time
import tty
from contextlib import suppress
from multiprocessing.connection import Connection

import numpy as np
import zmq
from msgspec.structs import replace

from fmfts.config import PadConfig
from fmfts.sensor.chips import DEFAULT_CHIP
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.packets import Hello, HelloPad, HelloSensor, Reply, Request, Sample
from fmfts_simulation.source import Simulated

RATE_HZ = 220
# The frame's temperature carries its number, so that each message shows its frame. The numbers last 37 s and span 64 K.
NUMBERS = 8192
RAW_PER_K = 128.0
ROOM_C = 25.0
CYCLE_S = 16.0  # period of the scripted finger
READ_BYTES = 65536


def samples(config: PadConfig, seconds: float) -> list[Sample]:
    """The samples that a board sends while a finger taps, presses and slides; they repeat after CYCLE_S."""
    return samples_of(Simulated(config), seconds)


def samples_of(source: Simulated, seconds: float) -> list[Sample]:
    """The samples that a board with this source's chips sends."""
    found: list[Sample] = []
    period_ns = round(1e9 / RATE_HZ)
    for step in range(round(seconds * RATE_HZ)):
        for frame in source.poll(step * period_ns):
            number = len(found)
            masks = [sum(1 << i for i in np.flatnonzero(mask).tolist()) for mask in (frame.valid, frame.fresh)]
            time_us = frame.device_time_us + 1_000_000
            sample = Sample(
                pad_index=0,
                sequence=number,
                time_us=time_us,
                gain_code=frame.gain_code,
                trigger=0,
                valid=masks[0],
                fresh=masks[1],
                temperature_raw=number % NUMBERS,
                counts=frame.counts,
                age_us=frame.age_us,
            )
            found.append(sample)
    return found


def boards(pipe: Connection, lines: list[bytes], count: int) -> None:
    """`count` boards with the same frames, each in its own phase. Sends the ports and waits for "go". Then sends the
    times (count, frames) in ns at which each frame's bytes were handed to the pty, and how many found no room."""
    ends, answers = ptys(count)
    pipe.send([os.ttyname(theirs) for _, theirs in ends])
    while not pipe.poll(0.02):
        answer(answers)
    pipe.recv()
    written_ns, lost = np.zeros((count, len(lines)), dtype=np.int64), 0
    period_ns = 1e9 / RATE_HZ
    start_ns = time.monotonic_ns() + 50_000_000
    for number, line in enumerate(lines):
        for pad, (ours, _) in enumerate(ends):
            due_ns = start_ns + round((number + pad / count) * period_ns)
            while (left_ns := due_ns - time.monotonic_ns()) > 0:
                time.sleep(left_ns * 1e-9)
            written_ns[pad, number] = time.monotonic_ns()
            try:
                os.write(ours, line)
            except BlockingIOError:
                lost += 1
        if number % 50 == 0:
            answer(answers)
    pipe.send((written_ns, lost))
    pipe.recv()


def steady_boards(pipe: Connection, cycle: list[Sample], count: int) -> None:
    """`count` boards that send the same frames over and over until told to stop. Sends the ports."""
    ends, answers = ptys(count)
    pipe.send([os.ttyname(theirs) for _, theirs in ends])
    period_ns, start_ns, number = 1e9 / RATE_HZ, time.monotonic_ns(), 0
    while not pipe.poll(0):
        line = encode(repeated(cycle, number))
        time.sleep(max(start_ns + round(number * period_ns) - time.monotonic_ns(), 0) * 1e-9)
        for ours, _ in ends:
            with suppress(BlockingIOError):
                os.write(ours, line)
        number += 1
        if number % 50 == 0:
            answer(answers)


def repeated(cycle: list[Sample], number: int) -> Sample:
    """The frame with this number, when the cycle is repeated."""
    rounds, place = divmod(number, len(cycle))
    passed_us = rounds * round(len(cycle) * 1e6 / RATE_HZ)
    return replace(cycle[place], sequence=number, time_us=cycle[place].time_us + passed_us)


def ptys(count: int) -> tuple[list[tuple[int, int]], dict[int, Decoder]]:
    """Both ends of each pty, and a decoder of the requests to each board."""
    ends = [os.openpty() for _ in range(count)]
    for ours, theirs in ends:
        tty.setraw(theirs)
        os.set_blocking(ours, False)
    return ends, {ours: Decoder() for ours, _ in ends}


def answer(answers: dict[int, Decoder]) -> None:
    """Answer every request at once. After the hello the daemon asks for nothing more."""
    hello = encode(
        Hello(
            (1, 0, 0), 1, 1, bytes(12), RATE_HZ, DEFAULT_CHIP.gain_code_for_range(2.5), 0, 1,
            (HelloPad(1, 0x70, tuple(HelloSensor(channel, 0, b"H43") for channel in range(4))),),
        )
    )  # fmt: skip
    for ours, decoder in answers.items():
        try:
            data = os.read(ours, READ_BYTES)
        except BlockingIOError:
            continue
        for packet in decoder.feed(data):
            if isinstance(packet, Request):
                os.write(ours, encode(Reply(packet.request_id, packet.verb, 0)) + hello)


def echo(pipe: Connection, endpoint: str, ports: list[str], size: int) -> None:
    """Reads the same bytes as the daemon, finds the packets, and publishes a message of `size` bytes for each: no
    Python program on the same sockets can take less time."""
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.XPUB)
    socket.bind(endpoint)
    epoll = select.epoll()
    topics, seen = {}, {}
    for index, port in enumerate(ports):
        descriptor = os.open(port, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        epoll.register(descriptor, select.EPOLLIN)
        topics[descriptor], seen[descriptor] = f"contact/p{index}".encode(), 0
    rest = bytes(size - 16)
    epoll.register(pipe.fileno(), select.EPOLLIN)  # polling the pipe each time would take longer than everything else
    while True:
        events = epoll.poll(0.05)
        if not events and not any(seen.values()):
            for topic in topics.values():
                socket.send_multipart((topic, b""))
        for descriptor, _ in events:
            if descriptor == pipe.fileno():
                return
            for _ in range(os.read(descriptor, READ_BYTES).count(0)):
                number = seen[descriptor]
                seen[descriptor] = number + 1
                socket.send(topics[descriptor], zmq.SNDMORE | zmq.NOBLOCK)
                socket.send(struct.pack("<qq", number, time.monotonic_ns()) + rest, zmq.NOBLOCK)


def subscriber(pipe: Connection, endpoint: str, count: int) -> None:
    """Sends "ready" when a message of every pad has come, and at the end [(pad, arrival in ns, payload), …]."""
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, 0)
    socket.connect(endpoint)
    socket.subscribe(b"contact/")
    heard: set[bytes] = set()
    messages: list[tuple[bytes, int, bytes]] = []
    poller = zmq.Poller()
    poller.register(socket, zmq.POLLIN)
    poller.register(pipe.fileno(), zmq.POLLIN)
    while True:
        readable = dict(poller.poll())
        if pipe.fileno() in readable:
            break
        if socket not in readable:
            continue
        while True:
            try:
                topic, payload = socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                break
            messages.append((topic, time.monotonic_ns(), payload))
            if len(heard) < count:
                heard.add(topic)
                if len(heard) == count:
                    pipe.send("ready")
                    messages.clear()
    pipe.send(messages)
