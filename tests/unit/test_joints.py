"""Joint positions over ZeroMQ: what a publisher sends arrives, and what is no such message is left out and counted."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq

from fmfts.bus.joints import JointListener, Positions
from fmfts_client import Endpoints, JointPublisher
from fmfts_client.joints import read_table
from ports import tcp_base

PATIENCE_S = 60.0


@pytest.fixture
def endpoints(tmp_path: Path) -> Endpoints:
    tmp_path.chmod(0o700)
    return Endpoints.from_base(f"ipc://{tmp_path}")


@pytest.fixture
def listener(endpoints: Endpoints) -> Iterator[JointListener]:
    made = JointListener(endpoints.joints)
    yield made
    made.close()


def next_of(listener: JointListener, say: Any) -> Positions | None:
    """The arrivals while `say` repeats its message: a publisher needs a moment to connect."""
    until = time.monotonic() + PATIENCE_S
    refused = listener.refused
    while time.monotonic() < until:
        say()
        if (told := listener.receive()) is not None:
            return told
        if listener.refused > refused:
            return None
        time.sleep(0.01)
    raise AssertionError("nothing arrived")


def test_published_positions_arrive_with_their_time(listener: JointListener, endpoints: Endpoints) -> None:
    with JointPublisher(endpoints) as publisher:
        told = next_of(listener, lambda: publisher.publish({"index": 0.25, "thumb": -1.0}, t_ns=123_456_789))
        assert told == ({"index": 0.25, "thumb": -1.0}, 123_456_789)
        before_ns = time.monotonic_ns()
        publisher.publish({"index": 0.5})
        until = time.monotonic() + PATIENCE_S
        while (told := listener.receive()) is None or told[1] == 123_456_789:
            assert time.monotonic() < until
        assert before_ns <= told[1] <= time.monotonic_ns()
        with pytest.raises(ValueError, match="'index' is nan"):
            publisher.publish({"index": float("nan")})


GOOD = {"v": 1, "t_ns": 5, "names": ["a"], "position_rad": [1.0]}
BAD: dict[str, Any] = {
    "no map": b"\x01",
    "a position without a name": msgpack.packb({**GOOD, "position_rad": [1.0, 2.0]}),
    "no joint": msgpack.packb({**GOOD, "names": [], "position_rad": []}),
    "too many joints": msgpack.packb({**GOOD, "names": ["a"] * 65, "position_rad": [0.0] * 65}),
    "a long name": msgpack.packb({**GOOD, "names": ["a" * 101]}),
    "infinity": msgpack.packb({**GOOD, "position_rad": [float("inf")]}),
    "a time before the boot": msgpack.packb({**GOOD, "t_ns": -1}),
    "text": msgpack.packb({**GOOD, "position_rad": ["1"]}),
}


@pytest.mark.parametrize("payload", BAD.values(), ids=BAD)
def test_invalid_message_is_dropped_and_counted(listener: JointListener, endpoints: Endpoints, payload: bytes) -> None:
    with zmq.Context.instance().socket(zmq.PUB) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(endpoints.joints)
        assert next_of(listener, lambda: socket.send_multipart((b"joints", payload))) is None
        assert listener.refused >= 1
        good = msgpack.packb({**GOOD, "t_ns": None})
        until = time.monotonic() + PATIENCE_S
        while (told := listener.receive()) is None:
            assert time.monotonic() < until
            socket.send_multipart((b"joints", good))
            time.sleep(0.01)
        assert told[0] == {"a": 1.0}


@pytest.mark.parametrize("parts", [(b"joints", b"\x01"), (b"joints", *[b"\x01"] * 40)], ids=["bad", "many parts"])
def test_flood_of_invalid_messages_keeps_to_its_time(
    listener: JointListener, endpoints: Endpoints, parts: tuple[bytes, ...]
) -> None:
    with zmq.Context.instance().socket(zmq.PUB) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(endpoints.joints)
        assert next_of(listener, lambda: socket.send_multipart(parts)) is None
        until, refused = time.monotonic() + PATIENCE_S, 0
        while not listener.may_have_more:
            assert time.monotonic() < until
            socket.send_multipart(parts)
            refused = listener.refused
            assert listener.receive(lambda: True) is None
        assert listener.refused == refused + 1, "one message, or three parts of it, at once"
        while listener.may_have_more:
            assert listener.receive(lambda: True) is None


def test_tcp_without_keys_is_refused() -> None:
    endpoints = Endpoints.from_base(tcp_base())
    listener = JointListener(endpoints.joints)
    try:
        with JointPublisher(endpoints) as publisher:
            assert next_of(listener, lambda: publisher.publish({"a": 1.0})) is None
    finally:
        listener.close()


def test_endpoint_of_joints_is_beside_the_bus() -> None:
    assert Endpoints.from_base("ipc:///run/fmfts").joints == "ipc:///run/fmfts/joints"
    assert Endpoints.from_base("tcp://10.0.0.5:5570").joints == "tcp://10.0.0.5:5573"


def test_recorded_table_is_played(listener: JointListener, endpoints: Endpoints, tmp_path: Path) -> None:
    table = tmp_path / "joints.csv"
    table.write_text("t_s,index,thumb\n0.0,0.1,0.2\n0.05,0.3,0.4\n")
    words = [sys.executable, "-m", "fmfts_client.joints", table, "--loop", "--bus", f"ipc://{tmp_path}"]
    with subprocess.Popen(words) as player:
        try:
            assert next_of(listener, lambda: None) is not None
        finally:
            player.terminate()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("s,a\n0,1\n1,2\n", "first column must be t_s"),
        ("", "first column must be t_s"),
        ("t_s,a\n", "must be two rows or more"),
        ("t_s,a\n0,1\n", "must be two rows or more"),
        ("t_s,a\n0,1\n1,open\n", "joints.csv: .*'open': each cell"),
        ("t_s,a\n0,1\n0,2\n", "does not rise"),
        ("t_s,a\n0,1\n1\n", "no 2 finite numbers"),
    ],
)
def test_invalid_table_is_refused(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "joints.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=why):
        read_table(path)


@pytest.mark.parametrize("endpoint", ["udp://here", "tcp://127.0.0.1"])
def test_player_says_in_a_sentence_that_an_endpoint_is_none(tmp_path: Path, endpoint: str) -> None:
    table = tmp_path / "joints.csv"
    table.write_text("t_s,a\n0,1\n0.01,1\n")
    words = [sys.executable, "-m", "fmfts_client.joints", table, "--bus", endpoint]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert endpoint in ended.stderr
    assert "Traceback" not in ended.stderr
