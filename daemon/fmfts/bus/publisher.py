"""Publishes contacts, events and status on one socket, and raw frames on another. Never blocks."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

import zmq

from fmfts.bus.encoding import NotFiniteError, encode, not_finite_field
from fmfts.bus.keys import ServerKey
from fmfts.bus.messages import (
    AnyMessage,
    ContactMessage,
    EarlyMessage,
    EventMessage,
    FrameMessage,
    StateMessage,
    StatusMessage,
    without_estimate,
)
from fmfts.bus.server import MESSAGE_BYTES, PEER_BYTES, BoundSocket
from fmfts_client.endpoints import Endpoints

# Messages that may wait for a slow subscriber before it loses some. For contacts, a second of each pad: nobody needs
# old ones. For frames many more: a recording needs them all, and has a queue of its own besides. PEER_BYTES bounds
# both: a contact has 1.2 kB, a frame 0.2 kB.
BUS_HIGH_MARK = 256
SAMPLES_A_FRAME = 5  # messages of a pad that publishes each sample: of four chips, and of the frame
MOST_ON_BUS = PEER_BYTES // (1200 + MESSAGE_BYTES)
FRAMES_HIGH_MARK = PEER_BYTES // (200 + MESSAGE_BYTES)
# The longest topic has 40 bytes, ZeroMQ's command around it 10, and other libraries' greetings a little more.
LARGEST_SUBSCRIPTION = 128
# libzmq itself handles subscriptions, in the loop's thread, while it sends: at most this many of each peer at a time.
SUBSCRIPTIONS_OF_A_PEER = 16
# Interval of the looks for new subscriptions: one look takes twice as long as sending a contact.
LOOK_NS = 50_000_000
# Plain integers: calculating with zmq's enumerations takes longer than a send.
NO_WAIT, NO_WAIT_AND_MORE = int(zmq.NOBLOCK), int(zmq.NOBLOCK | zmq.SNDMORE)
# Changes of subscriptions that are read at once; the next ones wait until the frame is sent.
LARGEST_BATCH = 64

log = logging.getLogger(__name__)


class Publisher:
    """Serves `endpoints.bus` and `endpoints.frames`.

    boot: this run's random word. key: encrypts tcp. pads: names of the pads whose raw frames clients may subscribe to.
    of_samples: how many of them publish each sample.

    `refused` counts the messages with NaN or infinity, which are errors of this program or of a contact model. Such a
    contact is sent as "lost", without an estimate, so that clients learn of it at once; other messages are not sent.
    Both are logged. Raises BusError where an endpoint cannot be bound.
    """

    def __init__(
        self,
        endpoints: Endpoints,
        boot: str,
        key: ServerKey | None = None,
        pads: Iterable[str] = (),
        of_samples: int = 0,
    ) -> None:
        self.boot = boot
        self.refused = 0
        names = list(pads)
        self._valid_topics = {prefix for pad in names for topic in _raw_topics(pad) for prefix in _prefixes(topic)}
        self._subscriptions: set[bytes] = set()
        self._look_ns = 0
        self._has_new_subscriber = self.may_have_more = False
        self._states_sent: set[str] = set()
        # PUB handles subscriptions by itself; XPUB, below, hands them to this program.
        second = BUS_HIGH_MARK * (max(len(names), 1) + (SAMPLES_A_FRAME - 1) * of_samples)
        high_mark = min(second, MOST_ON_BUS)
        limits = LARGEST_SUBSCRIPTION, key, SUBSCRIPTIONS_OF_A_PEER
        self._bus = BoundSocket(zmq.PUB, endpoints.bus, high_mark, *limits)
        try:
            self._frames = BoundSocket(zmq.XPUB, endpoints.frames, FRAMES_HIGH_MARK, *limits)
        except Exception:
            self._bus.close()
            raise
        # Report each subscription, not only the first to a topic: a second recorder needs a state too.
        self._frames.zmq.setsockopt(zmq.XPUB_VERBOSE, 1)

    def send_contact(self, pad: str, message: ContactMessage) -> ContactMessage:
        """Send a contact; returns it as it was sent: without estimates where one of them was NaN or infinity."""
        try:
            payload = encode(message)
        except NotFiniteError as error:
            self._refuse(error)
            message = _without_estimate(message, str(error))
            payload = encode(message)
        _send(self._bus, contact_topic(pad), payload)
        return message

    def send_encoded(self, topic: bytes, payload: bytes) -> None:
        """Send a contact that is encoded already, and has only finite numbers."""
        _send(self._bus, topic, payload)

    @property
    def sockets(self) -> tuple[BoundSocket, ...]:
        return self._bus, self._frames

    @property
    def address(self) -> int:
        """libzmq's handle of the contacts' socket, with which C sends in this thread."""
        return int(self._bus.zmq.underlying)

    def send_event(self, pad: str, message: EventMessage) -> None:
        self._send_checked(self._bus, f"event/{pad}".encode(), message)

    def send_status(self, pad: str, message: StatusMessage) -> None:
        self._send_checked(self._bus, f"status/{pad}".encode(), message)

    def frames_wanted(self, pad: str, now_ns: int) -> bool:
        """Does a client subscribe to this pad's raw frames or samples? Looks for new subscriptions once in LOOK_NS."""
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            self._follow_subscriptions()
        return bool(self._subscriptions) and (
            self._is_subscribed(f"frame/{pad}") or self._is_subscribed(f"early/{pad}")
        )

    def has_new_subscriber(self, time_is_up: Callable[[], bool]) -> bool:
        """Has a client subscribed to raw frames since the last call? Call it when `fileno` is readable, and now and
        then. It looks at one change at least, and at no more when `time_is_up`: then `may_have_more` is True."""
        self._follow_subscriptions(time_is_up)
        has_new, self._has_new_subscriber = self._has_new_subscriber, False
        return has_new

    def fileno(self) -> int:
        """Descriptor that becomes readable when subscriptions to raw frames may have changed. It signals edges only."""
        return int(self._frames.zmq.getsockopt(zmq.FD))

    def _follow_subscriptions(self, time_is_up: Callable[[], bool] = lambda: False) -> None:
        self.may_have_more = False
        for _ in range(LARGEST_BATCH):
            if not self._frames.readable():
                return
            change = b"".join(self._frames.zmq.recv_multipart(zmq.NOBLOCK))
            # XPUB reports every subscription (1), and the end of the last one to a topic (0).
            if change[:1] == b"\x01" and change[1:] in self._valid_topics:
                self._subscriptions.add(change[1:])
                self._has_new_subscriber = True
                self._states_sent.clear()
            elif change[:1] == b"\x00":
                self._subscriptions.discard(change[1:])
            if time_is_up():
                break
        self.may_have_more = True
        self._look_ns = 0  # look again with the next frame

    def state_wanted(self, pad: str) -> bool:
        """Does a client wait for this pad's state? Call it after `frames_wanted`."""
        return pad not in self._states_sent and self._is_subscribed(f"state/{pad}")

    def send_state(self, pad: str, message: StateMessage) -> None:
        self.state_told(pad)
        self._send_checked(self._frames, f"state/{pad}".encode(), message)

    def state_told(self, pad: str) -> None:
        """Mark the pad's state as sent; it is wanted again after a new subscription or `state_changed`."""
        self._states_sent.add(pad)

    def state_changed(self, pad: str) -> None:
        """Something other than a frame changed the pad's state: clients that record need it again."""
        self._states_sent.discard(pad)

    def _is_subscribed(self, topic: str) -> bool:
        return any(topic.encode().startswith(prefix) for prefix in self._subscriptions)

    def send_frame(self, pad: str, message: FrameMessage) -> None:
        self._send_checked(self._frames, f"frame/{pad}".encode(), message)

    def send_early(self, pad: str, message: EarlyMessage) -> None:
        self._send_checked(self._frames, f"early/{pad}".encode(), message)

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
                "%d message(s) contained NaN or infinity; the last: %s. The likely cause is the contact model "
                "(pad.contact.model): check the data that it was made from; with the default model, please report this",
                self.refused,
                error,
            )


def contact_topic(pad: str) -> bytes:
    return f"contact/{pad}".encode()


def _send(socket: BoundSocket, topic: bytes, payload: bytes) -> None:
    # XPUB never blocks: it drops messages for a slow subscriber. NOBLOCK would make a block an error.
    # The base class's `send`, without pyzmq's handling of routes and groups, which takes longer than the send.
    send_part = super(zmq.Socket, socket.zmq).send
    send_part(topic, NO_WAIT_AND_MORE)
    send_part(payload, NO_WAIT)


def _raw_topics(pad: str) -> tuple[str, ...]:
    return f"frame/{pad}", f"state/{pad}", f"early/{pad}"


def _prefixes(topic: str) -> list[bytes]:
    """All subscriptions that include this topic: ZeroMQ compares prefixes."""
    whole = topic.encode()
    return [whole[:length] for length in range(len(whole) + 1)]


def _without_estimate(message: ContactMessage, reason: str) -> ContactMessage:
    temperature_c = None if not_finite_field(message.temperature_c) else message.temperature_c
    return without_estimate(message, health="lost", reason=reason, over_range=False, temperature_c=temperature_c)
