"""Binding the daemon's sockets: who may connect, and that nobody else serves there already."""

from __future__ import annotations

import errno
import grp
import logging
import os
from pathlib import Path

import zmq

from fmfts.bus.keys import ServerKey
from fmfts.bus.lock import BusError, EndpointLock, socket_path
from fmfts_client.keys import is_loopback

GROUP = "fmfts"
# As members of enumerations they would cost more than the call.
EVENTS, POLLIN = int(zmq.EVENTS), int(zmq.POLLIN)
log = logging.getLogger(__name__)


class BoundSocket:
    """A bound ZeroMQ socket and the lock of its endpoint.

    `trusted`: only those come in who may change things, by the permissions of an ipc socket or by their keys.
    """

    def __init__(
        self, kind: int, endpoint: str, send_high_mark: int, largest_received: int, key: ServerKey | None = None
    ) -> None:
        """Raises BusError: another daemon serves there, the place is not accessible, or it is open to the network.

        key: what tcp is served with; without one, it is served on this machine alone.
        """
        path = socket_path(endpoint)
        if path is not None:
            _prepare_directory(path.parent, endpoint)
        elif key is None:
            _require_loopback(endpoint)
        self.trusted = path is not None or key is not None
        self._lock = EndpointLock(endpoint)
        self.zmq: zmq.Socket[bytes] = zmq.Context.instance().socket(kind)
        self.zmq.setsockopt(zmq.LINGER, 0)
        self.zmq.setsockopt(zmq.SNDHWM, send_high_mark)
        self.zmq.setsockopt(zmq.MAXMSGSIZE, largest_received)
        if path is None and key is not None:
            self.zmq.setsockopt(zmq.CURVE_SERVER, 1)
            self.zmq.setsockopt(zmq.CURVE_SECRETKEY, key.secret)
            self.zmq.setsockopt(zmq.ZAP_DOMAIN, b"fmfts")
            self.zmq.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # whoever the Gate does not answer for stays outside
        try:
            _bind(self.zmq, endpoint, path)
        except (zmq.ZMQError, OSError) as error:
            self.close()
            raise BusError(f"cannot serve {endpoint}: {error.strerror}{_advice(error)}") from error

    def readable(self) -> bool:
        return bool(int(self.zmq.getsockopt(EVENTS)) & POLLIN)

    def close(self) -> None:
        self.zmq.close()
        self._lock.release()


def _advice(error: zmq.ZMQError | OSError) -> str:
    if error.errno != errno.EADDRINUSE:
        return ""
    return ": another program, perhaps another fmfts-daemon, serves there: stop it, or choose another with FMFTS_BUS"


def _bind(socket: zmq.Socket[bytes], endpoint: str, path: Path | None) -> None:
    before = os.umask(0o117)  # the socket is 0660 from its first moment
    try:
        socket.bind(endpoint)
    finally:
        os.umask(before)
    if path is not None:
        _give_to_group(path)


def _give_to_group(path: Path) -> None:
    """To the group whose members may talk to the daemon, where it exists and is ours to give."""
    try:
        group = grp.getgrnam(GROUP).gr_gid
    except KeyError:
        return
    # The service's socket has the group already, and its sandbox allows no chown.
    if path.stat().st_gid != group and (os.geteuid() == 0 or group in os.getgroups()):
        os.chown(path, -1, group)


def _prepare_directory(directory: Path, endpoint: str) -> None:
    try:
        directory.mkdir(mode=0o750, exist_ok=True)
    except OSError as error:
        raise BusError(f"cannot serve {endpoint}: {directory}: {error.strerror}") from error


def _require_loopback(endpoint: str) -> None:
    """Off this machine anybody could listen and, over the control socket, re-record a baseline."""
    if not endpoint.startswith("tcp://") or not is_loopback(endpoint):
        raise BusError(
            f"{endpoint} would be open to the network without a key: serve ipc://… or tcp://127.0.0.1:port; or make "
            "keys: `[bus] keys` names their folder, `fmfts-daemon keys new NAME` makes one for each client"
        )
