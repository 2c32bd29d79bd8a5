"""`view --foxglove`: a client of Foxglove's protocol sees a real daemon's contacts; only this machine can connect."""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from end_to_end.processes import RunningDaemon

CONFIG = '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\n'
WANTED = {"contact/left", "scene/left", "magnet/left", "transform/left", "wrench/left", "status/left"}
PATIENCE_S = 60.0
MESSAGE = struct.Struct("<BIQ")  # opcode 1, subscription, time: the protocol's "message data"


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    with RunningDaemon(tmp_path, CONFIG) as daemon:
        command = [sys.executable, "-m", "fmfts", "view", "--foxglove", "--port", "0"]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=daemon.environment) as bridge:
            try:
                assert bridge.stdout is not None
                yield bridge.stdout.readline().split()[-1]
            finally:
                bridge.kill()
            assert bridge.stderr is not None
            assert "every user of this machine" in bridge.stderr.read(), "it says who can read"


def advertised(client: ClientConnection) -> dict[str, dict[str, object]]:
    """Channels by topic, once all wanted ones are there."""
    found: dict[str, dict[str, object]] = {}
    until = time.monotonic() + PATIENCE_S
    while not found.keys() >= WANTED:
        said = client.recv(until - time.monotonic())
        if isinstance(said, str) and (message := json.loads(said))["op"] == "advertise":
            found |= {channel["topic"]: channel for channel in message["channels"]}
    return found


def messages(client: ClientConnection, seconds: float) -> Iterator[tuple[int, int, dict[str, object]]]:
    """Subscription, time (ns) and content of the messages within this time."""
    until = time.monotonic() + seconds
    with suppress(TimeoutError):
        while (left := until - time.monotonic()) > 0:
            said = client.recv(left)
            if isinstance(said, bytes) and said[0] == 1:
                _, number, utc_ns = MESSAGE.unpack_from(said)
                yield number, utc_ns, json.loads(said[MESSAGE.size :])


def test_client_of_foxglove_gets_contacts_and_drawings(address: str) -> None:
    with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
        channels = advertised(client)
        assert channels["scene/left"]["schemaName"] == "foxglove.SceneUpdate"
        assert {channel["encoding"] for channel in channels.values()} == {"json"}
        topics = dict(enumerate(sorted(WANTED), start=1))
        subscriptions = [{"id": number, "channelId": channels[topic]["id"]} for number, topic in topics.items()]
        seen: dict[str, dict[str, object]] = {}
        until = time.monotonic() + PATIENCE_S
        while seen.keys() != WANTED:
            assert time.monotonic() < until, f"nothing came of {sorted(WANTED - seen.keys())}"
            # The SDK advertises a channel a moment before it accepts subscriptions, and ignores one that comes too
            # early.
            client.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
            for number, utc_ns, message in messages(client, 2.0):
                seen[topics[number]] = message
                assert abs(utc_ns - time.time_ns()) < PATIENCE_S * 1e9
            client.send(json.dumps({"op": "unsubscribe", "subscriptionIds": list(topics)}))
    assert seen["contact/left"]["pad"] == "left"
    assert seen["magnet/left"]["frame_id"] == "left"


def test_server_offers_nothing_that_changes_anything(address: str) -> None:
    with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
        said = json.loads(client.recv(PATIENCE_S))
    assert said["op"] == "serverInfo"
    assert said["capabilities"] == []


def test_only_this_machine_can_connect(address: str) -> None:
    host, port = address.removeprefix("ws://").split(":")
    assert host == "127.0.0.1"
    with pytest.raises(OSError, match="refused"):  # as for any other address of this machine
        socket.create_connection(("127.0.0.2", int(port)), timeout=PATIENCE_S).close()
