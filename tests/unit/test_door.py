"""The door to the bus: closed to new connections while too many files are open; connected clients stay."""

from __future__ import annotations

import errno
import logging
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq
from bus_messages import BOOT, contact_message, frame_message, status_message

from background import repeating
from fmfts.bus.control import LARGEST_RECEIVED, MOST_UNREAD, MOST_WAITING, ControlServer, Request
from fmfts.bus.door import LONGEST_LOOK_S, MEASURED_PER_S, MOST_CONNECTIONS, MOST_OF_A_CONNECTION, OF_THE_DAEMON, Door
from fmfts.bus.encoding import encode
from fmfts.bus.listener import Listener
from fmfts.bus.lock import BusError
from fmfts.bus.publisher import Publisher
from fmfts.bus.server import MESSAGE_BYTES, PEER_BYTES
from fmfts.service import open_files
from fmfts_client import Endpoints
from ports import tcp_base

ENOUGH = 4096
UNIT = Path(__file__).parents[2] / "systemd" / "fmfts.service"
KERNEL_BYTES = 212_992  # net.core.wmem_default


def may_filter() -> bool:
    """Whether a filter may be put on a socket here; some containers forbid it, and say so at each attempt."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        listener = Listener(server.fileno())
        try:
            listener.let_in(False)
        except PermissionError:
            return False
        finally:
            listener.close()
    return True


@pytest.fixture(params=["ipc", "tcp"])
def endpoint(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "tcp" and not may_filter():
        pytest.skip("this container forbids filters on sockets")
    return Endpoints.from_base(f"ipc://{tmp_path}" if request.param == "ipc" else tcp_base()).control


@pytest.fixture
def server(endpoint: str) -> Iterator[ControlServer]:
    server = ControlServer(endpoint)

    def serve() -> None:
        while server.serve_one(Request.reply):
            pass

    with repeating(serve, 0.002):
        yield server
    server.close()


class Peer:
    def __init__(self, endpoint: str) -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.linger = 0
        self.socket.connect(endpoint)

    def is_answered(self, within_ms: int) -> bool:
        self.socket.send(b"\x82\xa2id\x01\xa4verb\xa4pads")
        return bool(self.socket.poll(within_ms)) and bool(self.socket.recv())


def test_limit_that_leaves_no_client_a_file_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(open_files, "count", lambda: 60)
    with pytest.raises(BusError, match=r"only 120 files, .* the 60 .*LimitNOFILE"):
        Door([], limit=120)
    Door([], limit=122).close()


def test_full_daemon_lets_nobody_in_until_some_leave(
    server: ControlServer, endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    opened = 10
    monkeypatch.setattr(open_files, "count", lambda: opened)
    monkeypatch.setattr("fmfts.bus.door.LONGEST_LOOK_S", 3600.0)  # the test itself looks
    door = Door(server.sockets, ENOUGH)
    before, after = Peer(endpoint), Peer(endpoint)
    try:
        assert before.is_answered(60_000)
        after.socket.disconnect(endpoint)
        opened = ENOUGH
        door.look()
        assert not door.is_open
        after.socket.connect(endpoint)
        assert not after.is_answered(300)
        assert before.is_answered(60_000), "who is connected goes on"
        opened = 10
        door.look()
        assert door.is_open
        assert after.socket.poll(60_000)
    finally:
        door.close()
        for peer in (before, after):
            peer.socket.close()
    said = [record.getMessage() for record in caplog.records if record.name == "fmfts.bus.door"]
    assert len(said) == 2
    assert "no other program may connect" in said[0]
    assert "may connect to the bus again" in said[1]


def test_socket_that_cannot_be_closed_leaves_the_others_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    opened = 10
    monkeypatch.setattr(open_files, "count", lambda: opened)
    monkeypatch.setattr("fmfts.bus.door.LONGEST_LOOK_S", 3600.0)  # the test itself looks
    (tmp_path / "a" / "control.full").mkdir(parents=True)
    (tmp_path / "b").mkdir()
    controls = [ControlServer(f"ipc://{tmp_path}/{folder}/control") for folder in "ab"]
    door = Door([socket for control in controls for socket in control.sockets], ENOUGH)
    try:
        opened = ENOUGH
        door.look()
        door.look()
        assert not door.is_open
        assert (tmp_path / "b" / "control.full").is_socket(), "this one is closed"
        assert len([record for record in caplog.records if "Is a directory" in record.getMessage()]) == 1
        (tmp_path / "a" / "control.full").rmdir()
        door.look()
        assert (tmp_path / "a" / "control.full").is_socket(), "it is tried again"
        opened = 10
        door.look()
        assert door.is_open
        assert all((tmp_path / folder / "control").is_socket() for folder in "ab")
    finally:
        door.close()
        for control in controls:
            control.close()


def test_next_look_comes_before_a_flood_can_open_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(open_files, "count", lambda: 10)
    door = Door([], ENOUGH)
    try:
        waits_s = {}
        for opened in (10, 100, 521, 522, 647, 2000):
            monkeypatch.setattr(open_files, "count", lambda opened=opened: opened)
            waits_s[opened] = door.look()
            assert opened + waits_s[opened] * MEASURED_PER_S <= max(opened, 522) + MEASURED_PER_S * LONGEST_LOOK_S
        assert waits_s[522] == waits_s[2000] == LONGEST_LOOK_S, "whoever leaves a full daemon lets the next one in soon"
        assert waits_s[10] > 3 * LONGEST_LOOK_S - 1e-3
    finally:
        door.close()


def test_look_that_fails_does_not_end_the_thread(
    server: ControlServer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    looks = threading.Semaphore(0)
    door = Door(server.sockets, ENOUGH)

    def count() -> int:
        looks.release()
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(open_files, "count", count)
    try:
        assert all(looks.acquire(timeout=60) for _ in range(3))
    finally:
        door.close()
    assert len([record for record in caplog.records if "Too many open files" in record.getMessage()]) == 1


def test_peers_that_read_nothing_fit_into_the_units_memory() -> None:
    (line,) = [line for line in UNIT.read_text().splitlines() if line.startswith("MemoryMax=")]
    assert line == "MemoryMax=2G"
    connections = MOST_CONNECTIONS + MEASURED_PER_S * LONGEST_LOOK_S
    assert connections * MOST_OF_A_CONNECTION + OF_THE_DAEMON <= 2**31
    control = MOST_WAITING * LARGEST_RECEIVED + MOST_UNREAD * 64 * len(encode(status_message()))
    assert max(PEER_BYTES, control) + KERNEL_BYTES <= MOST_OF_A_CONNECTION


def test_queue_of_a_peer_is_bounded_with_many_pads(tmp_path: Path) -> None:
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), BOOT, None, [f"pad{n}" for n in range(64)], 64)
    try:
        bus, frames = (one.zmq.getsockopt(zmq.SNDHWM) for one in publisher.sockets)
        assert bus * (len(encode(contact_message())) + MESSAGE_BYTES) <= PEER_BYTES
        assert frames * (len(encode(frame_message(2**40))) + MESSAGE_BYTES) <= PEER_BYTES
    finally:
        publisher.close()


def test_closed_control_leaves_no_listening_socket() -> None:
    endpoint = Endpoints.from_base(tcp_base()).control
    ControlServer(endpoint).close()
    host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
    until = time.monotonic() + 60.0  # a thread of ZeroMQ closes it
    while time.monotonic() < until:
        try:
            socket.create_connection((host, int(port))).close()
        except ConnectionRefusedError:
            return
        time.sleep(0.001)
    raise AssertionError("somebody still listens")
