"""Sends commands to the daemon: a request gets progress messages while the daemon works, and one answer."""

from __future__ import annotations

import reprlib
import secrets
import time
from contextlib import suppress
from typing import Any, Callable, Optional, Union

import msgpack  # type: ignore[import-untyped]
import zmq

from fmfts_client.endpoints import Endpoints, for_client
from fmfts_client.keys import show_key
from fmfts_client.silence import why_silent


class ControlError(Exception):
    """The command was not carried out."""


class UnreachableError(ControlError):
    """No answer arrived in time."""


class RefusedError(ControlError):
    """The daemon answered with an error; the text is the daemon's.

    code: the exit code with which a command ends that meets the same error; None: the daemon told none.
    """

    def __init__(self, text: str, code: Optional[int] = None) -> None:
        super().__init__(text)
        self.code = code


def request(
    verb: str,
    *,
    endpoint: Optional[Union[str, Endpoints]] = None,
    timeout_s: float = 5.0,
    progress: Optional[Callable[[dict[str, Any]], None]] = None,
    **arguments: Any,
) -> dict[str, Any]:
    """Send the command `verb`; returns the daemon's answer, a map of facts.

    timeout_s: the longest silence; each progress message restarts it. progress: called with each progress message.
    Raises UnreachableError, RefusedError or EndpointError.
    """
    endpoints = for_client(endpoint)
    address = endpoints.control
    number = secrets.token_hex(8)
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
    with socket:
        socket.setsockopt(zmq.LINGER, 0)
        # A daemon that has refused the key reads nothing any more: without this, sending would wait for ever.
        socket.setsockopt(zmq.SNDTIMEO, round(timeout_s * 1e3))
        show_key(socket, address, endpoints.key)
        socket.connect(address)
        deadline = time.monotonic() + timeout_s
        with suppress(zmq.Again):
            socket.send(msgpack.packb({**arguments, "id": number, "verb": verb}))
            deadline = time.monotonic() + timeout_s
        while socket.poll(max(0, round((deadline - time.monotonic()) * 1e3))):
            reply = _decode(socket.recv_multipart()[-1])
            if reply.pop("id", None) != number:
                continue
            if "error" in reply:
                raise _refusal(verb, reply)
            if reply.pop("ok", None) is True:
                return reply
            deadline = time.monotonic() + timeout_s
            if progress is not None and isinstance(reply.get("progress"), dict):
                progress(reply["progress"])
    why = why_silent(address, key=endpoints.key)
    raise UnreachableError(f"{verb}: no answer from {address} for {timeout_s:g} s: {why}")


def _refusal(verb: str, reply: dict[str, Any]) -> RefusedError:
    error, code = reply["error"], reply.get("code")
    text = error if isinstance(error, str) else reprlib.repr(error)
    return RefusedError(f"{verb}: {text}", code if isinstance(code, int) else None)


def _decode(payload: bytes) -> dict[str, Any]:
    try:
        reply = msgpack.unpackb(payload)
    except (ValueError, msgpack.UnpackException) as error:
        raise ControlError(f"the daemon's answer cannot be decoded: {error}") from error
    if not isinstance(reply, dict):
        raise ControlError(f"the daemon's answer is not a map but {type(reply).__name__}")
    return reply
