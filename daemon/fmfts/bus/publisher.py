"""The daemon's voice: contacts, events and status on one socket, raw frames on another. Never blocks."""

from __future__ import annotations

import logging

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
    StatusMessage,
    encode,
    not_finite_field,
)
from fmfts.bus.server import BoundSocket
from fmfts_client.endpoints import Endpoints

# What a subscriber that does not keep up may hold back, in messages, before it loses some: a second of one pad. Old
# contacts help nobody; a recording wants every frame.
BUS_HIGH_MARK = 256
FRAMES_HIGH_MARK = 20_000
LARGEST_SUBSCRIPTION = 1024

log = logging.getLogger(__name__)


class Publisher:
    """Serves `endpoints.bus` and `endpoints.frames`; `boot` is this run's random word; over tcp with `key`.

    `refused` counts the messages that held a number that is none (an error of this program): such a contact goes out
    as "lost" without any estimate, so that listeners learn of it at once; anything else is withheld. Both are logged.
    Raises BusError when the endpoints cannot be had.
    """

    def __init__(self, endpoints: Endpoints, boot: str, key: ServerKey | None = None) -> None:
        self.boot = boot
        self.refused = 0
        self._subscriptions: set[bytes] = set()
        self._bus = BoundSocket(zmq.XPUB, endpoints.bus, BUS_HIGH_MARK, LARGEST_SUBSCRIPTION, key)
        try:
            self._frames = BoundSocket(zmq.XPUB, endpoints.frames, FRAMES_HIGH_MARK, LARGEST_SUBSCRIPTION, key)
        except Exception:
            self._bus.close()
            raise

    def send_contact(self, pad: str, message: ContactMessage) -> ContactMessage:
        """The message as it went out: without estimates where one of them was no number."""
        try:
            payload = encode(message)
        except NotFiniteError as error:
            self._refuse(error)
            message = _without_estimate(message, str(error))
            payload = encode(message)
        _send(self._bus, f"contact/{pad}", payload)
        return message

    def send_event(self, pad: str, message: EventMessage) -> None:
        self._send_checked(self._bus, f"event/{pad}", message)

    def send_status(self, pad: str, message: StatusMessage) -> None:
        _drain(self._bus)
        self._send_checked(self._bus, f"status/{pad}", message)

    def frames_wanted(self, pad: str) -> bool:
        """Does anybody subscribe to this pad's raw frames now?"""
        for change in _drain(self._frames):
            # XPUB hands on the first subscription to a topic (1) and the end of the last one (0).
            if change[:1] == b"\x01":
                self._subscriptions.add(change[1:])
            elif change[:1] == b"\x00":
                self._subscriptions.discard(change[1:])
        topic = f"frame/{pad}".encode()
        return any(topic.startswith(prefix) for prefix in self._subscriptions)

    def send_frame(self, pad: str, message: FrameMessage) -> None:
        self._send_checked(self._frames, f"frame/{pad}", message)

    def close(self) -> None:
        self._bus.close()
        self._frames.close()

    def _send_checked(self, socket: BoundSocket, topic: str, message: AnyMessage) -> None:
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


def _send(socket: BoundSocket, topic: str, payload: bytes) -> None:
    # XPUB drops for a subscriber that is full and never blocks; NOBLOCK turns a mistake about that into an error.
    socket.zmq.send_multipart((topic.encode(), payload), flags=zmq.NOBLOCK)


def _drain(socket: BoundSocket) -> list[bytes]:
    """Subscriptions pile up in the socket's memory until they are fetched."""
    changes = []
    while socket.readable():
        changes.append(b"".join(socket.zmq.recv_multipart(zmq.NOBLOCK)))
    return changes


def _without_estimate(message: ContactMessage, reason: str) -> ContactMessage:
    temperature_c = None if not_finite_field(message.temperature_c) else message.temperature_c
    return msgspec.structs.replace(
        message, **NO_ESTIMATE, health="lost", reason=reason, over_range=False, temperature_c=temperature_c
    )
