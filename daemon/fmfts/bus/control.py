"""Receives requests from clients on a ROUTER socket, which the daemon's own loop polls, and answers them."""

from __future__ import annotations

import errno
import logging
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
import zmq

from fmfts.bus.encoding import NotFiniteError, encode_facts, not_finite_field
from fmfts.bus.gate import key_of
from fmfts.bus.keys import KeyFolder, why_refused
from fmfts.bus.server import BoundSocket
from fmfts.bus.unread import Answer, Unread
from fmfts.common.exit_codes import DATA, code_of

READING = frozenset({"status", "probe", "pads"})
CHANGING = frozenset({"baseline", "selftest", "weigh"})
VERBS = READING | CHANGING
LARGEST_REQUEST = 1024  # the largest valid one has less than half of it
LARGEST_RECEIVED = 2 * LARGEST_REQUEST  # beyond this ZeroMQ closes the connection instead of answering
# Requests of one peer that wait in this process, and answers that one peer has not read. A peer that sends more waits
# in its own `send`; see unread.py for answers.
MOST_WAITING = MOST_UNREAD = 32
MOST_PARTS = 3  # a REQ socket's request has three parts with the sender's identity
DISCARDED_AT_ONCE = 32
MOST_ARGUMENTS = 16

log = logging.getLogger(__name__)
T = TypeVar("T")
Received = tuple[list[bytes], bytes]  # a message's parts, and the public key of its sender over tcp with keys
_decoder = msgspec.msgpack.Decoder(dict[str, Any])


class BadRequestError(ValueError):
    """A request is not valid; its sender receives the text."""


class NoSuchPadError(BadRequestError):
    """The request names a pad that the daemon does not have, or none where there are several."""


class AbsentError(BadRequestError):
    """The device that the request needs is not connected."""


class Request:
    """A client's request: `verb`, one of VERBS, and its `arguments`. Answer it once, with `reply` or `fail`."""

    def __init__(
        self, server: ControlServer, route: tuple[bytes, ...], identity: int | str, content: dict[str, Any]
    ) -> None:
        self.verb: str = content["verb"]
        self.arguments = {key: value for key, value in content.items() if key not in ("id", "verb")}
        self._server = server
        self._route = route
        self._identity = identity
        self.answered = False

    def arguments_as(self, kind: type[T]) -> T:
        """The arguments as a msgspec Struct (forbid_unknown_fields=True to be strict). Raises BadRequestError."""
        try:
            return msgspec.convert(self.arguments, kind)
        except msgspec.ValidationError as error:
            known = [field.name for field in msgspec.structs.fields(kind)]  # type: ignore[arg-type]
            unknown = [name for name in self.arguments if name not in known]
            takes = ", ".join(known) or "none"
            wrong = f"no argument '{unknown[0][:40]}'; it takes {takes}" if unknown else str(error)
            raise BadRequestError(f"{self.verb}: {wrong}") from error

    def reply(self, **facts: Any) -> None:
        """Answer that it is done. `facts` may hold messages, maps, lists, numbers and text."""
        try:
            answer = encode_facts({**facts, "id": self._identity, "ok": True})
        except NotFiniteError as error:
            log.error("the answer to %s is not sent, please report this program error: %s", self.verb, error)
            self.fail(f"internal error: {error}")
            return
        self._send(answer, last=True)

    def fail(self, text: str, code: int = DATA) -> None:
        """Answer that it was not done and nothing was changed; `text` says why. code: of common/exit_codes.py."""
        self._send(encode_facts({"id": self._identity, "error": text, "code": code}), last=True)

    def refuse(self, error: Exception) -> None:
        """Answer with an error whose cause common/exit_codes.py knows."""
        self.fail(str(error), code_of(error))

    def progress(self, **facts: Any) -> None:
        """Report that the work goes on; the answer comes later. A REQ socket takes one answer only: it gets none."""
        self._send(encode_facts({"id": self._identity, "progress": facts}), last=False)

    def _send(self, payload: bytes, last: bool) -> None:
        if self.answered:
            raise RuntimeError(f"{self.verb}: this request was answered already")
        self.answered = last
        if last:
            self._server._answer(self._route, payload)
        elif len(self._route) == 1:
            self._server._inform(self._route, payload)


class ControlServer:
    """Serves requests on `endpoint`; `keys` encrypt tcp, and say who may change things there.

    ZeroMQ takes requests from its peers in turn, so one that floods the socket delays another's by one request.

    may_have_more: `serve_one` may find a request that `fileno` does not signal. Raises BusError where the endpoint
    cannot be bound.
    """

    def __init__(self, endpoint: str, keys: KeyFolder | None = None) -> None:
        key = None if keys is None else keys.server()
        self._socket = BoundSocket(zmq.ROUTER, endpoint, MOST_UNREAD, LARGEST_RECEIVED, key, MOST_WAITING)
        self._keys = None if self._socket.path is not None else keys
        # Without it an answer to a peer that reads nothing would be dropped, without an error.
        self._socket.zmq.setsockopt(zmq.ROUTER_MANDATORY, 1)
        self._unread = Unread(self._is_sent)
        self._has_surplus_parts = False
        self.may_have_more = True

    @property
    def sockets(self) -> tuple[BoundSocket, ...]:
        return (self._socket,)

    def fileno(self) -> int:
        """Descriptor to wait for. ZeroMQ signals edges only: call `serve_one` until it is False."""
        return int(self._socket.zmq.getsockopt(zmq.FD))

    def serve_one(self, handle: Callable[[Request], None]) -> bool:
        """Take the next request: `handle` gets a valid one, any other gets an error. False if there is nothing to do.

        Also sends an answer that waits for a peer that did not read, if it reads now.
        """
        if self._has_surplus_parts:
            self._discard()
            return True
        delivered = self._unread.deliver_one()
        self.may_have_more = self._socket.readable()
        if not self.may_have_more:
            return delivered
        request = self._read(*self._receive())
        if request is not None:
            handle(request)
        return True

    def close(self) -> None:
        self._socket.close()

    def _receive(self) -> Received:
        """The first MOST_PARTS parts of the next message. A peer may send any number."""
        frames = [self._socket.zmq.recv(zmq.NOBLOCK, copy=False)]
        while frames[-1].more and len(frames) < MOST_PARTS:
            frames.append(self._socket.zmq.recv(zmq.NOBLOCK, copy=False))
        self._has_surplus_parts = frames[-1].more
        return [frame.bytes for frame in frames], b"" if self._keys is None else key_of(frames[-1])

    def _discard(self) -> None:
        """Drop the next parts of a message that has too many; `may_have_more` stays True meanwhile."""
        for _ in range(DISCARDED_AT_ONCE):
            self._has_surplus_parts = self._socket.zmq.recv(zmq.NOBLOCK, copy=False).more
            if not self._has_surplus_parts:
                return

    def _read(self, parts: list[bytes], key: bytes) -> Request | None:
        # DEALER sends [identity, body], REQ [identity, "", body].
        route = tuple(parts[:2] if len(parts) == 3 and not parts[1] else parts[:1])
        identity: int | str | None = None
        try:
            content = _decode(parts[len(route) :], self._has_surplus_parts)
            identity = _identity(content)
            _check(content)
            self._require_trust(content["verb"], key)
            self._require_reader(route)
            return Request(self, route, identity, content)
        except BadRequestError as error:
            self._answer(route, encode_facts({"id": identity, "error": str(error), "code": code_of(error)}))
            return None

    def _require_trust(self, verb: str, key: bytes) -> None:
        if self._keys is not None and (why := why_refused(self._keys, verb, verb in CHANGING, key)):
            raise BadRequestError(why)
        if verb in CHANGING and not self._socket.trusted:
            raise BadRequestError(
                f"{verb} is refused over tcp without keys, because any user of this machine could send it: use "
                "ipc://…, or give the daemon keys ([bus] keys)"
            )

    def _require_reader(self, route: tuple[bytes, ...]) -> None:
        if kept := self._unread.of(route):
            raise BadRequestError(
                f"nothing was done, because {MOST_UNREAD + kept} earlier answers to you were not read yet: read "
                "each answer before you ask again"
            )

    def _answer(self, route: tuple[bytes, ...], payload: bytes) -> None:
        if self._unread.of(route) or not self._is_sent((route, payload)):
            self._unread.keep((route, payload))

    def _inform(self, route: tuple[bytes, ...], payload: bytes) -> None:
        """Send something that may be dropped for a peer that reads nothing."""
        if not self._unread.of(route):
            self._is_sent((route, payload))

    def _is_sent(self, answer: Answer) -> bool:
        """False if the peer has MOST_UNREAD answers to read already. No answer is needed where the peer has gone."""
        self.may_have_more = True  # sending may consume the edge that announced a request
        route, payload = answer
        try:
            self._socket.zmq.send_multipart((*route, payload), flags=zmq.NOBLOCK)
        except zmq.Again:
            return False
        except zmq.ZMQError as error:
            if error.errno != errno.EHOSTUNREACH:
                raise
        return True


def _decode(body: list[bytes], has_surplus_parts: bool) -> dict[str, Any]:
    if len(body) != 1 or has_surplus_parts:
        raise BadRequestError("a request is one message part, not several")
    if len(body[0]) > LARGEST_REQUEST:
        raise BadRequestError(f"a request is at most {LARGEST_REQUEST} bytes, not {len(body[0])}")
    try:
        return _decoder.decode(body[0])
    except (msgspec.DecodeError, ValueError, TypeError, RecursionError) as error:  # TypeError: a key is a map
        raise BadRequestError(f"not a msgpack map with text keys: {error}") from error


def _identity(content: dict[str, Any]) -> int | str:
    identity = content.get("id")
    if isinstance(identity, str) and len(identity) <= 64:
        return identity
    if type(identity) is int and -(2**63) <= identity < 2**64:
        return identity
    raise BadRequestError("`id` must be an integer, or text of at most 64 characters: it comes back in the answer")


def _check(content: dict[str, Any]) -> None:
    verb = content.get("verb")
    if not isinstance(verb, str) or verb not in VERBS:
        shown = repr(verb[:40]) if isinstance(verb, str) else f"of type {type(verb).__name__}"
        raise BadRequestError(f"unknown verb {shown}: one of {', '.join(sorted(VERBS))}")
    if len(content) - 2 > MOST_ARGUMENTS:
        raise BadRequestError(f"{verb}: {len(content) - 2} arguments, and it takes {MOST_ARGUMENTS} at most")
    for name, value in content.items():
        if isinstance(value, dict | list):
            raise BadRequestError(f"{verb}: {name[:80]} must be text, a number, true, false or null")
    if field := not_finite_field(content):
        raise BadRequestError(f"{verb}: {field[:80]} is not a finite number")
