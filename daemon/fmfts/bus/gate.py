"""Who comes in over the network: libzmq asks (ZAP, RFC 27) about the key that a peer has proved to hold."""

from __future__ import annotations

import logging

import zmq

from fmfts.bus.keys import KeyFolder
from fmfts.bus.lock import BusError

ZAP_ENDPOINT = "inproc://zeromq.zap.01"
LARGEST_BATCH = 64

log = logging.getLogger(__name__)


class Gate:
    """Answers on the daemon's own loop: a peer waits for its turn of it, the frames never for a peer.

    One for a process. `refused` counts those who were sent away.
    """

    def __init__(self, keys: KeyFolder) -> None:
        self._keys = keys
        self.refused = 0
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.bind(ZAP_ENDPOINT)

    def fileno(self) -> int:
        """To wait on. ZeroMQ signals it at edges only: call `answer` many times a second too."""
        return int(self._socket.getsockopt(zmq.FD))

    def answer(self) -> None:
        for _ in range(LARGEST_BATCH):
            if not int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
                return
            route, empty, version, request, _domain, address, _identity, mechanism, *proof = (
                self._socket.recv_multipart()
            )
            good = mechanism == b"CURVE" and len(proof) == 1 and self._allows(proof[0])
            if not good:
                self._refuse(address.decode(errors="replace"))
            status = (b"200", b"OK") if good else (b"400", b"unknown key")
            self._socket.send_multipart((route, empty, version, request, *status, b"", b""))

    def close(self) -> None:
        # libzmq has a thread that closes; until it comes to it the endpoint would be taken.
        self._socket.unbind(ZAP_ENDPOINT)
        self._socket.close()

    def _allows(self, public: bytes) -> bool:
        """A list that cannot be read lets nobody in."""
        try:
            return self._keys.allows(public)
        except (BusError, OSError) as error:
            log.error("nobody is let in: %s", error)
            return False

    def _refuse(self, address: str) -> None:
        self.refused += 1
        if self.refused == 1 or self.refused % 1000 == 0:
            log.warning(
                "%d peer(s) without a key of %s sent away; this one: %s", self.refused, self._keys.folder, address
            )
