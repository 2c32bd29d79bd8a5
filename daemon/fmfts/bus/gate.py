"""Decides which clients may connect over the network: answers libzmq's requests (ZAP, RFC 27) about a peer's key."""

from __future__ import annotations

import logging
from collections.abc import Callable

import zmq
from zmq.utils import z85

from fmfts.bus.client_list import KeysError
from fmfts.bus.keys import KeyFolder
from fmfts_client.keys import decoded

ZAP_ENDPOINT = "inproc://zeromq.zap.01"
LARGEST_BATCH = 64

log = logging.getLogger(__name__)


def key_of(frame: zmq.Frame) -> bytes:
    """The public key (32 bytes) of the peer that sent a message over tcp with keys; a Gate admitted it."""
    return decoded(str(frame.get("User-Id"))) or b""


class Gate:
    """Admits the clients of a key folder. The daemon's loop answers, between frames, so that peers never delay frames.

    There is one Gate in a process. `refused` counts the peers that it refused.
    """

    def __init__(self, keys: KeyFolder) -> None:
        self._keys = keys
        self.refused = 0
        self._logged = ""
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.bind(ZAP_ENDPOINT)

    def fileno(self) -> int:
        """Descriptor to wait for. ZeroMQ signals edges only: call `answer` many times a second too."""
        return int(self._socket.getsockopt(zmq.FD))

    def answer(self, time_is_up: Callable[[], bool] = lambda: False) -> bool:
        """Answer the requests that have arrived: one at least, LARGEST_BATCH at most, and no more when `time_is_up`.

        True if there may be more.
        """
        for _ in range(LARGEST_BATCH):
            if not int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
                return False
            route, empty, version, request, _domain, address, _identity, mechanism, *proof = (
                self._socket.recv_multipart()
            )
            allowed = mechanism == b"CURVE" and len(proof) == 1 and self._allows(proof[0])
            if not allowed:
                self._refuse(address.decode(errors="replace"))
            # The key is the peer's user id: libzmq adds it to all its messages, and `key_of` reads it.
            answer = (b"200", b"OK", z85.encode(proof[0])) if allowed else (b"400", b"unknown key", b"")
            self._socket.send_multipart((route, empty, version, request, *answer, b""))
            if time_is_up():
                break
        return True

    def close(self) -> None:
        # libzmq closes in another thread, later; without unbind the endpoint would stay in use until then.
        self._socket.unbind(ZAP_ENDPOINT)
        self._socket.close()

    def _allows(self, public: bytes) -> bool:
        """Is this key on the list? While the list cannot be read, no key is."""
        try:
            return self._keys.client_with(public) is not None
        except KeysError as error:
            if str(error) != self._logged:  # not for each peer that connects
                self._logged = str(error)
                log.error("no client is let in: %s", error)
            return False

    def _refuse(self, address: str) -> None:
        self.refused += 1
        if self.refused == 1 or self.refused % 1000 == 0:
            log.warning(
                "refused %d peer(s) without a key of %s; the last: %s", self.refused, self._keys.folder, address
            )
