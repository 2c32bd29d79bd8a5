"""Receives the joint positions that a robot's program publishes, between frames."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping

import msgspec
import zmq

from fmfts.bus.gate import key_of
from fmfts.bus.keys import KeyFolder, why_refused
from fmfts.bus.messages import JointsMessage
from fmfts.bus.server import BoundSocket
from fmfts.common import possible

TOPIC = b"joints"
LARGEST_RECEIVED = 16_384
LONGEST_NAME = 100
MOST_PARTS = 3  # parts that are read at once: one more than a message has, because a peer may send any number
MOST_WAITING = 100  # messages kept of one peer; a busy daemon drops older ones
LOGGED_AGAIN_S = 60.0
log = logging.getLogger(__name__)
_decoder = msgspec.msgpack.Decoder(JointsMessage)
Positions = tuple[Mapping[str, float], int]  # by joint, in rad, and their time on the host's clock


class JointListener:
    """Serves `endpoint`; `keys` encrypt tcp. refused: number of unusable messages. may_have_more: `receive` had no time
    left. BusError where the endpoint cannot be bound."""

    def __init__(self, endpoint: str, keys: KeyFolder | None = None) -> None:
        key = None if keys is None else keys.server()
        self._socket = BoundSocket(zmq.SUB, endpoint, 1, LARGEST_RECEIVED, key, MOST_WAITING)
        self._socket.zmq.setsockopt(zmq.SUBSCRIBE, TOPIC)
        self._keys = None if self._socket.path is not None else keys
        self.refused, self.may_have_more = 0, False
        self._logged_s = -LOGGED_AGAIN_S

    @property
    def sockets(self) -> tuple[BoundSocket, ...]:
        return (self._socket,)

    def fileno(self) -> int:
        """Descriptor to wait for. ZeroMQ signals edges only: call `receive` until it is None and has no more."""
        return int(self._socket.zmq.getsockopt(zmq.FD))

    def receive(self, time_is_up: Callable[[], bool] = lambda: False) -> Positions | None:
        """The next positions; None if none is waiting, or if the time is up, as a peer may send other messages."""
        self.may_have_more = False
        while self._socket.readable():
            parts = self._parts()
            try:
                self._require_trust(parts[-1])
                return _positions([part.bytes for part in parts])
            except (msgspec.DecodeError, ValueError) as error:
                self._refuse(str(error))
            if time_is_up():
                self.may_have_more = True
                break
        return None

    def close(self) -> None:
        self._socket.close()

    def _parts(self) -> list[zmq.Frame]:
        parts = [self._socket.zmq.recv(zmq.NOBLOCK, copy=False)]
        while parts[-1].more and len(parts) < MOST_PARTS:
            parts.append(self._socket.zmq.recv(zmq.NOBLOCK, copy=False))
        return parts

    def _require_trust(self, part: zmq.Frame) -> None:
        if self._keys is not None and (why := why_refused(self._keys, "joints", True, key_of(part))):
            raise ValueError(why)
        if not self._socket.trusted:
            raise ValueError("joint positions over tcp are refused without keys: use ipc://…, or set [bus] keys")

    def _refuse(self, why: str) -> None:
        self.refused += 1
        if time.monotonic() - self._logged_s >= LOGGED_AGAIN_S:
            self._logged_s = time.monotonic()
            log.warning("%d message(s) with joint positions were left out; the last: %s", self.refused, why[:300])


def _positions(parts: list[bytes]) -> Positions:
    """ValueError or msgspec.DecodeError if it is no message of joints."""
    if len(parts) != 2:
        raise ValueError(f"{len(parts)} parts, not a topic and a map (docs/messages.md)")
    message = _decoder.decode(parts[1])
    if len(message.names) != len(message.position_rad) or not 0 < len(message.names) <= possible.MOST_JOINTS:
        raise ValueError(
            f"{len(message.names)} names and {len(message.position_rad)} positions: as many of each, "
            f"1 to {possible.MOST_JOINTS}: publish the joints of the hand alone"
        )
    if max(map(len, message.names)) > LONGEST_NAME:
        raise ValueError(f"a joint's name has more than {LONGEST_NAME} letters")
    possible.JOINT_RAD.require(message.position_rad)
    now_ns = time.monotonic_ns()
    time_ns = now_ns if message.t_ns is None else message.t_ns
    if not 0 <= time_ns < 1 << 62:
        raise ValueError(f"t_ns is {time_ns}: it is the time of this computer's CLOCK_MONOTONIC")
    return dict(zip(message.names, message.position_rad, strict=True)), time_ns
