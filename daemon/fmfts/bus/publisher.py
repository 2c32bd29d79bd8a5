"""The daemon's voice: contacts, events and status on one socket, raw frames on another. Never blocks."""

from __future__ import annotations

import logging
from collections.abc import Iterable

import msgspec
import zmq

from fmfts.bus.keys import ServerKey
from fmfts.bus.messages import (
    NO_ESTIMATE,
    AnyMessage,
    ContactMessage,
    EventMessage,
    FrameMessage,
    NotFiniteError,
    StateMessage,
    StatusMessage,
    encode,
    not_finite_field,
)
from fmfts.bus.server import BoundSocket
from fmfts_client.endpoints import Endpoints

# What a subscriber that does not keep up may hold back, in messages, before it loses some: a second of each pad. Old
# contacts help nobody; a recording wants every frame.
BUS_HIGH_MARK = 256
FRAMES_HIGH_MARK = 20_000
LARGEST_SUBSCRIPTION = 1024
# Asking the socket costs twice as much as sending a contact; whoever records waits for so long.
LOOK_NS = 50_000_000
# As members of an enumeration they cost more than a send.
NO_WAIT, NO_WAIT_AND_MORE = int(zmq.NOBLOCK), int(zmq.NOBLOCK | zmq.SNDMORE)
# Of what peers subscribe to, fetched at once: what else they do waits until the frame is sent.
LARGEST_BATCH = 64

log = logging.getLogger(__name__)


class Publisher:
    """Serves `endpoints.bus` and `endpoints.frames`; `boot` is this run's random word; over tcp with `key`.

    pads: names of those that are served, whose raw frames may be asked for.

    `refused` counts the messages that held a number that is none (an error of this program): such a contact goes out
    as "lost" without any estimate, so that listeners learn of it at once; anything else is withheld. Both are logged.
    Raises BusError when the endpoints cannot be had.
    """

    def __init__(self, endpoints: Endpoints, boot: str, key: ServerKey | None = None, pads: Iterable[str] = ()) -> None:
        self.boot = boot
        self.refused = 0
        names = list(pads)
        self._answered = {prefix for pad in names for topic in _raw_topics(pad) for prefix in _prefixes(topic)}
        self._subscriptions: set[bytes] = set()
        self._look_ns = 0
        self._states_told: set[str] = set()
        # PUB keeps to itself what peers subscribe to: nobody has to fetch it.
        high_mark = BUS_HIGH_MARK * max(len(names), 1)
        self._bus = BoundSocket(zmq.PUB, endpoints.bus, high_mark, LARGEST_SUBSCRIPTION, key)
        try:
            self._frames = BoundSocket(zmq.XPUB, endpoints.frames, FRAMES_HIGH_MARK, LARGEST_SUBSCRIPTION, key)
        except Exception:
            self._bus.close()
            raise
        # What pyzmq's own `send` adds (routes, groups) takes longer than the send.
        self._send_part = super(zmq.Socket, self._bus.zmq).send
        # A second recorder needs a state as well as the first.
        self._frames.zmq.setsockopt(zmq.XPUB_VERBOSE, 1)

    def send_contact(self, pad: str, message: ContactMessage) -> ContactMessage:
        """The message as it went out: without estimates where one of them was no number."""
        try:
            payload = encode(message)
        except NotFiniteError as error:
            self._refuse(error)
            message = _without_estimate(message, str(error))
            payload = encode(message)
        _send(self._bus, contact_topic(pad), payload)
        return message

    def send_packed(self, topic: bytes, payload: bytes) -> None:
        """A contact that is a map already, all of whose numbers are numbers."""
        self._send_part(topic, NO_WAIT_AND_MORE)
        self._send_part(payload, NO_WAIT)

    @property
    def address(self) -> int:
        """The contacts' socket as libzmq knows it, for `send_function` of this thread."""
        return int(self._bus.zmq.underlying)

    def send_event(self, pad: str, message: EventMessage) -> None:
        self._send_checked(self._bus, f"event/{pad}".encode(), message)

    def send_status(self, pad: str, message: StatusMessage) -> None:
        self._send_checked(self._bus, f"status/{pad}".encode(), message)

    def frames_wanted(self, pad: str, now_ns: int) -> bool:
        """Does anybody subscribe to this pad's raw frames? Looked up once in LOOK_NS at most."""
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            self._follow_subscriptions()
        return bool(self._subscriptions) and self._is_subscribed(f"frame/{pad}")

    def anything_wanted(self) -> bool:
        """Does anybody subscribe to raw frames of any pad? To be asked when `fileno` is readable, and now and then."""
        self._follow_subscriptions()
        return bool(self._subscriptions)

    def fileno(self) -> int:
        """Readable when subscriptions to raw frames may have changed: at edges only."""
        return int(self._frames.zmq.getsockopt(zmq.FD))

    def _follow_subscriptions(self) -> None:
        for _ in range(LARGEST_BATCH):
            if not self._frames.readable():
                return
            change = b"".join(self._frames.zmq.recv_multipart(zmq.NOBLOCK))
            # XPUB hands on every subscription (1), and the end of the last one to a topic (0).
            if change[:1] == b"\x01" and change[1:] in self._answered:
                self._subscriptions.add(change[1:])
                self._states_told.clear()
            elif change[:1] == b"\x00":
                self._subscriptions.discard(change[1:])
        self._look_ns = 0  # there may be more: go on with the next frame

    def state_wanted(self, pad: str) -> bool:
        """Does somebody wait for this pad's state? Ask after `frames_wanted`."""
        return pad not in self._states_told and self._is_subscribed(f"state/{pad}")

    def send_state(self, pad: str, message: StateMessage) -> None:
        self.state_told(pad)
        self._send_checked(self._frames, f"state/{pad}".encode(), message)

    def state_told(self, pad: str) -> None:
        """Until another subscribes, or it changes."""
        self._states_told.add(pad)

    def state_changed(self, pad: str) -> None:
        """Not by a frame: whoever records is to be told anew."""
        self._states_told.discard(pad)

    def _is_subscribed(self, topic: str) -> bool:
        return any(topic.encode().startswith(prefix) for prefix in self._subscriptions)

    def send_frame(self, pad: str, message: FrameMessage) -> None:
        self._send_checked(self._frames, f"frame/{pad}".encode(), message)

    def close(self) -> None:
        self._bus.close()
        self._frames.close()

    def _send_checked(self, socket: BoundSocket, topic: bytes, message: AnyMessage) -> None:
        try:
            payload = encode(message)
        except NotFiniteError as error:
            self._refuse(error)
            return
        _send(socket, topic, payload)

    def _refuse(self, error: NotFiniteError) -> None:
        self.refused += 1
        if self.refused == 1 or self.refused % 1000 == 0:
            log.error(
                "%d message(s) held a number that is none; this one: %s. The likely cause is the contact model "
                "(pad.contact.model): check what it was made from; from the default one it is worth reporting",
                self.refused,
                error,
            )


def contact_topic(pad: str) -> bytes:
    return f"contact/{pad}".encode()


def _send(socket: BoundSocket, topic: bytes, payload: bytes) -> None:
    # XPUB drops for a subscriber that is full and never blocks; NOBLOCK turns a mistake about that into an error.
    socket.zmq.send_multipart((topic, payload), flags=zmq.NOBLOCK)


def _raw_topics(pad: str) -> tuple[str, str]:
    return f"frame/{pad}", f"state/{pad}"


def _prefixes(topic: str) -> list[bytes]:
    """All that a peer may subscribe to in order to get this topic."""
    whole = topic.encode()
    return [whole[:length] for length in range(len(whole) + 1)]


def _without_estimate(message: ContactMessage, reason: str) -> ContactMessage:
    temperature_c = None if not_finite_field(message.temperature_c) else message.temperature_c
    return msgspec.structs.replace(
        message, **NO_ESTIMATE, health="lost", reason=reason, over_range=False, temperature_c=temperature_c
    )
