"""Receives the messages of the bus, of one pad or of all."""

from __future__ import annotations

import reprlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Optional, Union

import msgpack  # type: ignore[import-untyped]
import zmq

from fmfts_client.clock import SenderClock
from fmfts_client.endpoints import EndpointError, Endpoints, for_client
from fmfts_client.fields import MessageError, SchemaError, check_version
from fmfts_client.keys import show_key

LARGEST_MESSAGE = 1 << 20
FRAME_SOCKET_KINDS = {"frame", "early", "state"}
HEARTBEATS_MISSED = 2.5
# A machine that is off does not answer, and TCP asks ever more rarely; a heartbeat asks again at this interval.
TRY_ANEW_S = 2.0


@dataclass(frozen=True)
class Message:
    """`kind`: first word of the topic ("contact", "event", "status", "frame", "early", "state"). `body`: the map.

    clock_ahead_s: by how much this machine's monotonic clock is ahead of that of the times in `body`; None: not known.
    """

    kind: str
    pad: str
    body: dict[str, Any]
    clock_ahead_s: Optional[float] = 0.0


class Subscription:
    """Receives the messages of `kinds`, of `pad` or of all pads. Reconnects by itself; only one thread may use it.

    A message that cannot be decoded is skipped, counted in `refused` and explained in `refusal`. Another schema version
    raises SchemaError. "frame", "early" and "state" come from another socket than the other kinds.

    watch: makes `monitor`, a socket with libzmq's events of the connection (made, refused, lost); else that is None.
    heartbeat_s: asks the daemon's ZeroMQ for a sign of life so often, and gives the connection up for lost where none
    comes for HEARTBEATS_MISSED times as long; None: only what the network itself reports is known, and a cable that was
    pulled is not.
    """

    def __init__(
        self,
        kinds: Sequence[str] = ("contact", "event", "status"),
        pad: Optional[str] = None,
        endpoint: Optional[Union[str, Endpoints]] = None,
        watch: bool = False,
        heartbeat_s: Optional[float] = None,
    ) -> None:
        raw = set(kinds) & FRAME_SOCKET_KINDS
        if raw and set(kinds) - FRAME_SOCKET_KINDS:
            raise ValueError("frames and states come over a socket of their own: subscribe to them alone")
        self.endpoints = for_client(endpoint)
        self.refused = 0
        self.refusal = ""
        self._kinds = tuple(kinds)
        self._pad = pad
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, LARGEST_MESSAGE)
        if raw:
            self._socket.setsockopt(zmq.RCVHWM, 100_000)  # a recording needs every frame: 7 min of one pad at 220 Hz
        if heartbeat_s is not None:
            self._socket.setsockopt(zmq.HEARTBEAT_IVL, round(heartbeat_s * 1e3))
            self._socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, round(HEARTBEATS_MISSED * heartbeat_s * 1e3))
            self._socket.setsockopt(zmq.CONNECT_TIMEOUT, round(TRY_ANEW_S * 1e3))
        for kind in self._kinds:
            self._socket.subscribe(f"{kind}/{pad or ''}")
        endpoint = self.endpoints.frames if raw else self.endpoints.bus
        try:
            show_key(self._socket, endpoint, self.endpoints.key)
        except EndpointError:
            self._socket.close()
            raise
        # ipc is within one machine, with one clock. tcp may come from anywhere: through a tunnel, even on the loopback.
        self._clock = SenderClock() if endpoint.startswith("tcp://") else None
        self.monitor: Optional[zmq.Socket[Any]] = self._socket.get_monitor_socket() if watch else None
        self._socket.connect(endpoint)

    @property
    def socket(self) -> zmq.Socket[bytes]:
        """The socket, for polling several subscriptions at once."""
        return self._socket

    def receive(self, timeout_s: Optional[float] = None) -> Optional[Message]:
        """The next message, or None after `timeout_s` seconds (None: wait for ever; 0: do not wait)."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            if not self.wait(None if deadline is None else deadline - time.monotonic()):
                return None
            message = self._accept(self._socket.recv_multipart())
            if message is not None:
                return message

    def wait(self, timeout_s: Optional[float] = None) -> bool:
        """Wait until a message can be received; False after `timeout_s` seconds (None: wait for ever)."""
        return bool(self._socket.poll(None if timeout_s is None else max(0, round(timeout_s * 1e3))))

    def refuse(self, error: Exception) -> None:
        """Count a message that must not be used."""
        self.refused += 1
        self.refusal = str(error) or f"it is no msgpack ({type(error).__name__})"  # msgpack's own errors are silent

    def _accept(self, parts: Sequence[bytes]) -> Optional[Message]:
        try:
            kind, _, pad = parts[0].decode().partition("/")
            # ZeroMQ compares prefixes: a subscription to contact/left gets contact/left2 too.
            if kind not in self._kinds or self._pad not in (None, pad):
                return None
            if len(parts) != 2:
                raise MessageError(f"{kind}/{pad}: {len(parts)} parts instead of topic and body")
            body = msgpack.unpackb(parts[1])
            if not isinstance(body, dict):
                raise MessageError(f"{kind}/{pad}: not a map but {type(body).__name__}")
            check_version(body)
            if body.get("pad") != pad:
                raise MessageError(f"{kind}/{pad}: is for pad {reprlib.repr(body.get('pad'))}")
            return Message(kind, pad, body, self._clock_ahead_s(body))
        except SchemaError:
            raise
        except (ValueError, msgpack.UnpackException) as error:  # MessageError and wrong UTF-8 are ValueErrors
            self.refuse(error)
            return None

    def _clock_ahead_s(self, body: dict[str, Any]) -> Optional[float]:
        if self._clock is None:
            return 0.0
        boot, sent_ns = body.get("boot"), body.get("t_publish_ns")
        if type(boot) is str and type(sent_ns) is int:
            self._clock.take(boot, sent_ns * 1e-9, time.monotonic())
        return self._clock.ahead_s

    def close(self) -> None:
        if self.monitor is not None:
            self._socket.disable_monitor()
            self.monitor.close()
            self.monitor = None
        self._socket.close()

    def __enter__(self) -> Subscription:
        return self

    def __exit__(
        self, kind: Optional[type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()
