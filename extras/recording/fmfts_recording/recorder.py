"""`fmfts-daemon record`: subscribes to a daemon, in a process of its own, so that a slow disk does not delay it."""

from __future__ import annotations

import logging
import signal
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import zmq

from fmfts.config import PadConfig
from fmfts.config.pad_facts import pad_facts
from fmfts.view.silence import require_pad, why_nothing_came
from fmfts.view.tally import WITHOUT_FRAMES
from fmfts_client import Endpoints, Message, Subscription
from fmfts_client.endpoints import for_client
from fmfts_recording.file import RecordingError, RecordingWriter
from fmfts_recording.ros2 import RosPad
from fmfts_recording.scene import PadScene

log = logging.getLogger("fmfts")

FLUSH_S = 1.0
PATIENCE_S = 5.0
TURN_S = 0.1
BATCH = 1000
MOST_BEFORE_STATE = 1000  # contacts of a pad that wait for its state: 4.5 s


class NothingCameError(RecordingError):
    """No message arrived, so there is nothing to record."""


def _why_without_frames(contact: dict[str, Any]) -> str:
    """contact: the pad's last. Its frames are left out before its first `state`."""
    if contact["health"] not in WITHOUT_FRAMES:
        return "its first `state`, without which frames cannot be replayed, had not come yet: record for longer"
    return f"{contact['health']}: {contact['reason']}"


class Recorder:
    """Writes a daemon's messages. Leaves out a pad's frames before its first state: they could not be replayed."""

    def __init__(
        self, output: Path, pad: str | None, endpoint: str | Endpoints | None, *, for_ros: bool = False
    ) -> None:
        """pad: record this pad and its neighbours; None: all pads. for_ros: contacts also in ROS 2's encoding.

        Raises EndpointError, NoSuchPadError or RecordingError.
        """
        require_pad(for_client(endpoint), pad)
        self._pad = pad
        self._group = None if pad is None else with_neighbours(pad, endpoint)
        pad = pad if self._group == {pad} else None
        # Subscribe to contacts first: then every recorded frame has its contact.
        self._bus = Subscription(("contact", "event", "status"), pad, endpoint)
        with ExitStack() as opened:
            opened.enter_context(closing(self._bus))
            self._frames = opened.enter_context(closing(Subscription(("frame", "early", "state"), pad, endpoint)))
            self._writer = RecordingWriter(output)
            opened.pop_all()  # from here on, `close` closes them
        self._poller = zmq.Poller()
        for subscription in (self._bus, self._frames):
            self._poller.register(subscription.socket, zmq.POLLIN)
        self._with_state: set[str] = set()
        self._contact: dict[str, dict[str, Any]] = {}  # of each pad, the last
        self._scenes: dict[str, PadScene | None] = {}
        self._for_ros = for_ros
        self._ros: dict[str, RosPad] = {}
        self._before_state: dict[str, deque[dict[str, Any]]] = {}
        self._next_seq: dict[tuple[str, str], int] = {}
        self.missed = 0
        self._stop_requested = False

    def run(self, seconds: float | None) -> dict[str, Any]:
        """Record for `seconds` (None: for ever) or until a signal; returns facts of the recording.

        Raises RecordingError where nothing arrives, or the disk is full.
        """
        with self._ended_by_signals():
            begun_s = flushed_s = time.monotonic()
            while not self._stop_requested and (seconds is None or time.monotonic() - begun_s < seconds):
                self._turn()
                now_s = time.monotonic()
                if not self._writer.messages and now_s - begun_s > PATIENCE_S:
                    break
                if now_s - flushed_s > FLUSH_S:
                    flushed_s = now_s
                    self._writer.flush()
            if not self._writer.messages:
                self._writer.discard()
                why = why_nothing_came(self._bus.endpoints, self._pad)
                raise NothingCameError(
                    f"nothing came in {time.monotonic() - begun_s:.1f} s, so nothing was recorded: {why}"
                )
            self._writer.finish()
        return {
            "recording": str(self._writer.path),
            "seconds": round(time.monotonic() - begun_s, 1),
            "messages": self._writer.messages,
            "pads": sorted(self._with_state),
            "missed_contacts": self.missed,
            "refused_messages": self._bus.refused + self._frames.refused,
        }

    def without_frames(self) -> list[str]:
        """Of each pad that sent messages but no frames: a sentence that says why."""
        return [
            f"no frames of pad '{pad}' were recorded: {_why_without_frames(contact)}"
            for pad, contact in sorted(self._contact.items())
            if pad not in self._with_state
        ]

    def close(self) -> None:
        self._writer.close()
        self._frames.close()
        self._bus.close()

    @contextmanager
    def _ended_by_signals(self) -> Iterator[None]:
        """SIGINT and SIGTERM set a flag inside: an exception during a write would leave a chunk unfinished."""
        before = {number: signal.signal(number, self._end) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _end(self, *_: object) -> None:
        self._stop_requested = True

    def _turn(self) -> None:
        self._poller.poll(round(TURN_S * 1e3))
        for subscription in (self._frames, self._bus):
            for _ in range(BATCH):
                message = subscription.receive(0.0)
                if message is None:
                    break
                self._take(message)

    def _take(self, message: Message) -> None:
        if self._group is not None and message.pad not in self._group:
            return
        if message.kind == "state":
            self._with_state.add(message.pad)
        elif message.kind in ("frame", "early") and message.pad not in self._with_state:
            return
        elif message.kind == "contact":
            key, seq = (message.pad, message.body["boot"]), message.body["seq"]
            self.missed += seq - self._next_seq.get(key, seq)
            self._next_seq[key] = seq + 1
            self._contact[message.pad] = message.body
        self._writer.add(message.kind, message.pad, message.body)
        if message.kind == "state":
            self._draw_from_now_on(message)
        elif message.kind == "contact" and (scene := self._scenes.get(message.pad)) is not None:
            for drawn in scene.contact(message.body):
                self._writer.draw(drawn, message.body["utc_ns"])
            self._tell_ros(message.pad, message.body)
        elif message.kind == "contact" and self._for_ros and message.pad not in self._scenes:
            self._before_state.setdefault(message.pad, deque(maxlen=MOST_BEFORE_STATE)).append(message.body)

    def _tell_ros(self, pad: str, body: dict[str, Any]) -> None:
        if (ros := self._ros.get(pad)) is not None:
            for told in ros.contact(body):
                self._writer.tell_ros(told, body["utc_ns"])

    def _draw_from_now_on(self, state: Message) -> None:
        if self._scenes.get(state.pad) is not None:
            return
        self._scenes[state.pad] = None
        try:
            facts = pad_facts(msgspec.convert(state.body["config"], PadConfig))
        except msgspec.ValidationError as error:
            log.warning(
                "pad '%s': no 3-D scene and no ROS 2 messages are recorded: this daemon has another version: %s",
                state.pad,
                error,
            )
            return
        self._scenes[state.pad] = PadScene(state.pad, facts)
        if self._for_ros:
            self._ros[state.pad] = RosPad(state.pad, facts)
            for body in self._before_state.pop(state.pad, ()):
                self._tell_ros(state.pad, body)


def with_neighbours(pad: str, endpoint: str | Endpoints | None) -> set[str]:
    """A pad, its neighbours, their neighbours and so on.

    A pad's contacts depend on its neighbours' magnets, so that a replay needs all of them. The neighbours of a pad that
    sends no frames are not known.
    """
    group, asked = {pad}, set[str]()
    while unasked := group - asked:
        name = min(unasked)
        asked.add(name)
        with Subscription(("frame", "state"), name, endpoint) as messages:
            until_s = time.monotonic() + PATIENCE_S
            while (message := messages.receive(until_s - time.monotonic())) is not None:
                if message.kind == "state":
                    group |= set(message.body["config"]["scene"]["neighbours"])
                    break
    return group
