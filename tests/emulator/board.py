"""A board at the far end of a pty that speaks the wire: it sends what a test tells it to, and answers like the
firmware.

Only for events that the real firmware cannot produce on demand; all else is tested against the firmware itself.
"""

from __future__ import annotations

import os
import tty
from pathlib import Path

import numpy as np

from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.packets import (
    Hello,
    HelloPad,
    HelloSensor,
    Packet,
    Reply,
    Request,
    Sample,
    Selftest,
    SelftestSensor,
    Status,
    StatusPad,
    Verb,
)

UID = bytes(range(1, 13))


class Board:
    """Sits at `link`, a symbolic link to the pty's other end, as udev's by-id links are."""

    def __init__(self, link: Path, uid: bytes = UID, sensors: int = 4, pads: int = 1) -> None:
        self.uid, self.sensors, self.pads = uid, sensors, pads
        self.gain_code, self.rate_hz, self.trigger, self.running = 3, 220, 0, 1
        self.states = [[0] * sensors for _ in range(pads)]
        self.identification = b"H43"
        self.requests: list[Request] = []
        self.deaf = False
        self.result = 0
        self.sequence = [0] * pads
        self.time_us = 0
        self.decoder = Decoder()
        self.link = link
        self.plug()

    def plug(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(self.slave))
        os.close(self.slave)

    def unplug(self) -> None:
        self.link.unlink(missing_ok=True)
        os.close(self.master)

    def send(self, *packets: Packet) -> None:
        os.write(self.master, b"".join(encode(packet) for packet in packets))

    def sample(self, pad_index: int = 0, **changes: object) -> Sample:
        everyone = (1 << self.sensors) - 1
        fields: dict = {
            "pad_index": pad_index,
            "sequence": self.sequence[pad_index],
            "time_us": self.time_us,
            "gain_code": self.gain_code,
            "trigger": self.trigger,
            "valid": everyone,
            "fresh": everyone,
            "temperature_raw": 128,
            "counts": np.arange(3 * self.sensors, dtype=np.int16).reshape(-1, 3),
            "age_us": np.zeros(self.sensors, np.uint16),
        }
        self.sequence[pad_index] += 1
        return Sample(**(fields | changes))

    def stream(self, count: int = 1) -> None:
        for _ in range(count):
            self.time_us += 4545
            self.send(*(self.sample(pad) for pad in range(self.pads)))

    def hello(self) -> Hello:
        pads = tuple(
            HelloPad(1, 0x70 + i, tuple(HelloSensor(c, s, self.identification) for c, s in enumerate(states)))
            for i, states in enumerate(self.states)
        )
        settings = (self.gain_code, self.trigger, self.running)
        return Hello((0, 1, 0), 1, 1, self.uid, self.rate_hz, *settings, pads)

    def status(self) -> Status:
        return Status(self.time_us, 0, 0, tuple(StatusPad(0, 0, 0, tuple(states)) for states in self.states))

    def serve(self) -> None:
        """Answer what has arrived."""
        try:
            data = os.read(self.master, 4096)
        except OSError:  # false: nothing is there, or nobody has the other end open
            return
        for request in self.decoder.feed(data):
            assert isinstance(request, Request)
            self.requests.append(request)
            if not self.deaf:
                self._answer(request)

    def _answer(self, request: Request) -> None:
        self.send(Reply(request.request_id, request.verb, self.result))
        if self.result:
            return
        match request.verb:
            case Verb.HELLO:
                self.send(self.hello())
            case Verb.RANGE:
                self.gain_code = request.argument
            case Verb.RATE:
                self.rate_hz = request.argument
            case Verb.TRIGGER:
                self.trigger = request.argument
            case Verb.START:
                self.running = 1
            case Verb.STATUS:
                self.send(self.status())
            case Verb.SELFTEST:
                readings = SelftestSensor(0, (452, 452, 421), (-452, -452, -421))
                self.send(Selftest(request.request_id, request.pad_index, 5, (readings,) * self.sensors))
