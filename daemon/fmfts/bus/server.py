"""Binds the daemon's sockets: sets who may connect, and refuses an endpoint that another daemon serves."""

from __future__ import annotations

import errno
import grp
import logging
import os
import stat
from pathlib import Path

import zmq

from fmfts.bus.keys import ServerKey
from fmfts.bus.listener import Listener, bound_to_tcp
from fmfts.bus.lock import ANOTHER_PLACE, BusError, EndpointLock, socket_path
from fmfts_client.endpoints import name_of, trusted_owners
from fmfts_client.keys import is_loopback

GROUP = "fmfts"
# Plain integers: zmq's enumerations would take longer than the call.
EVENTS, POLLIN = int(zmq.EVENTS), int(zmq.POLLIN)
# ZeroMQ ends a connection without its handshake after so long. Over ipc a handshake takes well under a millisecond.
HANDSHAKE_MS = 5000
# What one peer that reads nothing may make this process keep; door.py adds it up. Peers share a message's body, but
# those that stopped reading at different times keep different ones, so each is counted as if it kept them alone.
PEER_BYTES = 2_000_000
# Beside the body: libzmq keeps 64 bytes for each of two parts, and its own head of a body, for which malloc rounds up.
MESSAGE_BYTES = 256
LARGEST_HANDSHAKE = 512  # bytes of an encrypted connection's handshake; MAXMSGSIZE limits it too
log = logging.getLogger(__name__)


class BoundSocket:
    """A bound ZeroMQ socket and the lock of its endpoint.

    `path`: file of an ipc socket, else None. `listener`: a tcp socket's, else None.
    `trusted`: only clients that may change things can connect, because of an ipc socket's permissions or their keys.
    """

    def __init__(
        self,
        kind: int,
        endpoint: str,
        send_high_mark: int,
        largest_received: int,
        key: ServerKey | None = None,
        receive_high_mark: int | None = None,
    ) -> None:
        """Bind `endpoint`. key: encrypts tcp; without one, tcp must be on the loopback interface. send_high_mark,
        receive_high_mark: how many messages for or of one peer may wait.

        Raises BusError: another daemon serves the endpoint, it cannot be accessed, or it is open to the network.
        """
        path = socket_path(endpoint)
        if path is not None:
            _prepare_directory(path.parent, endpoint)
        elif key is None:
            _require_loopback(endpoint)
        self.path = path
        self.trusted = path is not None or key is not None
        self.listener: Listener | None = None
        self._lock = EndpointLock(endpoint)
        self.zmq: zmq.Socket[bytes] = zmq.Context.instance().socket(kind)
        self.zmq.setsockopt(zmq.LINGER, 0)
        self.zmq.setsockopt(zmq.SNDHWM, send_high_mark)
        if receive_high_mark is not None:
            self.zmq.setsockopt(zmq.RCVHWM, receive_high_mark)
        self.zmq.setsockopt(zmq.MAXMSGSIZE, largest_received)
        self.zmq.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        if path is None and key is not None:
            self.zmq.setsockopt(zmq.MAXMSGSIZE, max(largest_received, LARGEST_HANDSHAKE))
            self.zmq.setsockopt(zmq.CURVE_SERVER, 1)
            self.zmq.setsockopt(zmq.CURVE_SECRETKEY, key.secret)
            self.zmq.setsockopt(zmq.ZAP_DOMAIN, b"fmfts")
            self.zmq.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without a Gate's answer, no peer may connect
        try:
            self.listener = _bind(self.zmq, endpoint, path)
        except (zmq.ZMQError, OSError) as error:
            self.close()
            raise BusError(f"cannot serve {endpoint}: {error.strerror}{_advice(error)}") from error

    def readable(self) -> bool:
        return bool(int(self.zmq.getsockopt(EVENTS)) & POLLIN)

    def close(self) -> None:
        if self.listener is not None:
            self.listener.close()
        self.zmq.close()
        self._lock.release()


def _advice(error: zmq.ZMQError | OSError) -> str:
    if error.errno != errno.EADDRINUSE:
        return f"; {ANOTHER_PLACE}"
    return ": another program, perhaps another fmfts-daemon, serves there: stop it, or choose another with FMFTS_BUS"


def _bind(socket: zmq.Socket[bytes], endpoint: str, path: Path | None) -> Listener | None:
    if path is None:
        return bound_to_tcp(socket, endpoint)
    before = os.umask(0o117)  # the socket is 0660 from its first moment
    try:
        socket.bind(endpoint)
    finally:
        os.umask(before)
    _give_to_group(path)
    return None


def _give_to_group(path: Path) -> None:
    """Gives the socket's file to the group GROUP, where it exists and this user may do so."""
    try:
        group = grp.getgrnam(GROUP).gr_gid
    except KeyError:
        return
    # The service's socket has this group already, and its sandbox allows no chown.
    if path.stat().st_gid != group and (os.geteuid() == 0 or group in os.getgroups()):
        os.chown(path, -1, group)


def _prepare_directory(directory: Path, endpoint: str) -> None:
    try:
        directory.mkdir(mode=0o750, exist_ok=True)
        status = directory.stat()
    except OSError as error:
        raise BusError(f"cannot serve {endpoint}: {directory}: {error.strerror}; {ANOTHER_PLACE}") from error
    if status.st_uid not in trusted_owners() or status.st_mode & stat.S_IWOTH:
        raise BusError(
            f"cannot serve {endpoint}: {directory} belongs to {name_of(status.st_uid)} "
            f"({stat.filemode(status.st_mode)}), so another user could replace the sockets there and send false "
            "forces. Name a folder of your own (mkdir -m 750) with FMFTS_BUS or [bus] endpoint"
        )


def _require_loopback(endpoint: str) -> None:
    """Refuses other endpoints: anybody in the network could listen and, over the control socket, record baselines."""
    if not endpoint.startswith("tcp://") or not is_loopback(endpoint):
        raise BusError(
            f"{endpoint} would be open to the network without a key: serve ipc://… or tcp://127.0.0.1:port; or make "
            "keys: `[bus] keys` names their folder, `fmfts-daemon keys new NAME` makes one for each client"
        )
