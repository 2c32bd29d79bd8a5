"""The door to the bus: closed to new connections while too many files are open; who is connected stays."""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq

from background import repeating
from fmfts.bus.control import ControlServer, Request
from fmfts.bus.door import Door
from fmfts.service import open_files
from fmfts_client import Endpoints
from ports import tcp_base

ENOUGH = 4096


@pytest.fixture(params=["ipc", "tcp"])
def endpoint(request: pytest.FixtureRequest, tmp_path: Path) -> str:
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


def test_full_daemon_lets_nobody_in_until_some_leave(
    server: ControlServer, endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    opened = 10
    monkeypatch.setattr(open_files, "count", lambda: opened)
    door = Door(server.sockets, ENOUGH)
    before, after = Peer(endpoint), Peer(endpoint)
    try:
        assert before.is_answered(5000)
        after.socket.disconnect(endpoint)
        opened = ENOUGH
        door.look()
        assert not door.is_open
        after.socket.connect(endpoint)
        assert not after.is_answered(300)
        assert before.is_answered(5000), "who is connected goes on"
        opened = 10
        door.look()
        assert door.is_open
        assert after.socket.poll(10_000)
    finally:
        door.close()
        for peer in (before, after):
            peer.socket.close()
    said = [record.getMessage() for record in caplog.records if record.name == "fmfts.bus.door"]
    assert len(said) == 2
    assert "no other program may connect" in said[0]
    assert "may connect to the bus again" in said[1]


def test_closed_control_leaves_no_listening_socket() -> None:
    endpoint = Endpoints.from_base(tcp_base()).control
    ControlServer(endpoint).close()
    host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
    for _ in range(1000):
        try:
            socket.create_connection((host, int(port))).close()
        except ConnectionRefusedError:
            return
    raise AssertionError("somebody still listens")
