"""A pad whose bytes go to the bus in C when possible, and otherwise through frames; and a subscriber to all of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgspec
import zmq
from test_pipeline import pipeline_of

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.config import BridgeSource, PadConfig
from fmfts.pipeline import _pad
from fmfts.pipeline.encoded import Answer, message_of
from fmfts.pipeline.lead import Lead
from fmfts.runtime.fast_loop import send_function
from fmfts.sensor import Frame
from fmfts.sensor.patience import BEHIND, IN_TIME
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.link import Link
from fmfts.sensor.wire.packets import TEMPERATURE_UNKNOWN, Sample
from fmfts.sources import on_board

TOPIC = b"contact/demo"


def sample_of(frame: Frame) -> Sample:
    _, valid, fresh, _ = frame.packed
    return Sample(
        pad_index=0,
        sequence=frame.sequence,
        time_us=frame.device_time_us + 1_000_000,
        gain_code=frame.gain_code,
        trigger=0,
        valid=valid,
        fresh=fresh,
        temperature_raw=TEMPERATURE_UNKNOWN if frame.temperature_c is None else round((frame.temperature_c - 25) * 128),
        counts=frame.counts,
        age_us=frame.age_us,
    )


@dataclass
class Told:
    messages: list[ContactMessage]
    expressed: int
    changes: int = 0


LEAD = Lead(1.45e-3, 1.1e-3)


def link_of(config: PadConfig) -> tuple[Link, DeviceClock]:
    on_bridge = msgspec.structs.replace(config, source=BridgeSource(port="/dev/null", publish="sample"))
    link = Link({0: on_board(on_bridge)}, SourceState("a board"), clock := DeviceClock())
    link.restart()
    return link, clock


class Bus:
    """A publisher's socket as the loop has it, and a subscriber to everything sent. epoll: of a loop that waits."""

    def __init__(self, epoll: int = -1) -> None:
        self._ours, self._theirs = (zmq.Context.instance().socket(kind) for kind in (zmq.PUB, zmq.SUB))
        for socket in (self._ours, self._theirs):
            socket.setsockopt(zmq.LINGER, 0)
            socket.setsockopt(zmq.SNDHWM, 0)
            socket.setsockopt(zmq.RCVHWM, 0)
        self._ours.bind(f"inproc://{id(self)}")
        self._theirs.connect(f"inproc://{id(self)}")
        self._theirs.subscribe(TOPIC)  # subscribes to topics that begin with it, too
        self._heard: dict[bytes, list[bytes]] = {}
        send = send_function()
        assert send is not None
        self.loop = _pad.Loop(epoll, send, int(self._ours.underlying), IN_TIME, BEHIND)
        while not self._theirs.poll(0):  # until the subscription has arrived
            self._ours.send_multipart((TOPIC, b""))
        self.heard()

    def heard(self, topic: bytes = TOPIC) -> list[bytes]:
        """New messages under this topic since the last call."""
        while self._theirs.poll(0):
            told, payload = self._theirs.recv_multipart()
            self._heard.setdefault(told, []).append(payload)
        return self._heard.pop(topic, [])

    def close(self) -> None:
        self._ours.close()
        self._theirs.close()


class Host:
    """A pad whose bytes go to the loop when possible, and otherwise through frames, as in the daemon."""

    LINE = 3
    overdue_ns = 1 << 62  # the frames' times are not this computer's

    def __init__(
        self, config: PadConfig, baseline: Baseline, bus: Bus, may_express: bool = True, line: int = LINE
    ) -> None:
        self.line, self._topic = line, TOPIC if line == self.LINE else TOPIC + bytes([line])
        self.baseline = baseline
        self.link, self.clock = link_of(config)
        self.pipeline, self._bus, self._may_express = pipeline_of(config, baseline, LEAD), bus, may_express
        self.lent: _pad.Pad | None = None
        self.told = Told([], 0)

    def take(self, data: bytes, arrival_ns: int) -> None:
        if self.lent is not None and self._bus.loop.take(self.line, data, arrival_ns):
            return
        if self.lent is not None:
            data = self.end()
        frames = self.link.feed(data, arrival_ns)
        for number, frame in enumerate(frames):
            self._tell(self.pipeline.early(early) for before, early in self.link.early if before == number)
            self._tell([self.pipeline.answer(frame)])
        self._tell(self.pipeline.early(early) for before, early in self.link.early if before == len(frames))
        self.begin()

    def _tell(self, answers: Iterable[Answer | None]) -> None:
        for answer in answers:
            if answer is not None:
                self.told.messages.append(message_of(answer))

    def begin(self) -> None:
        if not (self._may_express and self.link.accepts(0)):
            return
        self.lent = self.pipeline.begin(self.clock.line, self._topic, 0, self.overdue_ns)
        if self.lent is not None:
            self._bus.loop.begin(self.line, self.link.give_back(), (self.lent,))

    def end(self) -> bytes:
        """The bytes that the loop has left unread."""
        assert self.lent is not None
        left = self._bus.loop.end(self.line)
        assert left is not None
        ended, payloads = self.pipeline.end(self.lent), self._bus.heard(self._topic)
        self.lent = None
        if ended is not None:
            passed, last = ended
            assert len(passed.latencies_s) <= passed.frames <= len(payloads)
            assert payloads[-1] == passed.payload == last.payload
            assert last.message.t_sample_ns == last.t_sample_ns == passed.t_sample_ns
            assert last.message.seq == self.pipeline.messages
            self.told.changes += len(passed.changes)
            assert set(passed.changes) <= set(payloads)
            self.told.expressed += len(payloads)
            self.told.messages += [msgspec.msgpack.decode(payload, type=ContactMessage) for payload in payloads]
        return left[0]
