"""A gauge that sends datagrams: who may send them, and what a flood of them costs."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from fmfts.sensor import Frame
from fmfts_collect import datagrams
from fmfts_collect.clock import Clock
from fmfts_collect.datagrams import (
    FLOODED_NS,
    LARGEST_DATAGRAM,
    LONGEST_POLL_NS,
    LONGEST_READ_NS,
    MOST_AT_ONCE,
    MOST_LINES,
    MOST_SOCKETS,
    OWNERS_NS,
    Datagrams,
    Owners,
)  # fmt: skip
from fmfts_collect.errors import AbsentError, StoppedError
from fmfts_collect.gauge import Gauge, open_gauge
from fmfts_collect.settings import CollectConfig, UdpGauge, problems
from fmfts_collect.watch import Limits, Watch
from ports import free_udp_port

NOT_MORE = MOST_AT_ONCE + 10  # the kernel's own buffer takes some 300
SEND = """
import os, socket, sys
os.setuid(65534)
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sender.sendto(b"9.99", ("127.0.0.1", int(sys.argv[1])))
print(flush=True)
if sys.argv[2] == "stays":
    sys.stdin.read()
"""


@pytest.fixture
def port() -> int:
    return free_udp_port()


@pytest.fixture
def gauge(port: int) -> Iterator[Gauge]:
    gauge = open_gauge(UdpGauge(port=port), None)
    yield gauge
    gauge.close()


@pytest.fixture
def sender() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        yield sender


def forces(gauge: Gauge, now_ns: int = 0) -> list[float]:
    """The forces that have arrived: over the loopback interface a datagram arrives before its sender continues."""
    return [reading.force_n for reading in gauge.poll(now_ns)]


def test_udp_gauge_is_read_by_its_pattern(gauge: Gauge, port: int, sender: socket.socket) -> None:
    sender.sendto(b"1.25\n1.5", ("127.0.0.1", port))
    assert forces(gauge) == [1.25, 1.5]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
@pytest.mark.parametrize("how", ["stays", "leaves"])
def test_force_of_another_user_is_not_read(gauge: Gauge, port: int, sender: socket.socket, how: str) -> None:
    words = [sys.executable, "-I", "-S", "-c", SEND, str(port), how]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as stranger:
        assert stranger.stdout is not None
        assert stranger.stdout.readline() == b"\n"
        if how == "leaves":
            stranger.communicate()
        sender.sendto(b"0.5", ("127.0.0.1", port))
        assert forces(gauge) == [0.5]
        why = (
            "another user's program (uid 65534)"
            if how == "stays"
            else "let the program that sends keep one socket open"
        )
        assert why in gauge.unread
        stranger.communicate()


@pytest.mark.parametrize("host", ["127.0.0.1", "::", "::ffff:127.0.0.1"])
def test_socket_whose_port_others_could_share_is_refused(host: str) -> None:
    """Another user's socket on 127.0.0.2 could send as it and be closed before its owner is looked up."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind((host, 0))
        assert "neither connected nor bound" in Owners().why_not(bound.getsockname()[1], 0)


def test_owner_of_an_unconnected_socket_is_found() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("0.0.0.0", 0))
        owners, number = Owners(), bound.getsockname()[1]
        assert owners.why_not(number, 0) == ""
    assert owners.why_not(number, OWNERS_NS // 2) == "", "the table is read again after a while only"
    assert "does not show whose it is" in owners.why_not(number, 2 * OWNERS_NS)


HEADING = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
ENTRY = (
    "  {}: {}:{:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000 {:5d}        0 1234 2 0000000000000000 0\n"
)


def owners_of(*sockets: tuple[str, int, int]) -> str:
    """A table of the kernel with these addresses, ports and users."""
    return HEADING + "".join(ENTRY.format(number, *socket) for number, socket in enumerate(sockets))


@pytest.mark.parametrize("table", ["udp", "udp6"])
@pytest.mark.parametrize("address", ["0200007F", "0" * 8, "0" * 32, "0000000000000000FFFF00000200007F"])
def test_stranger_with_the_same_port_is_refused(
    address: str, table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At any address: a socket on 127.0.0.2 sends as 127.0.0.1."""
    (tmp_path / "udp").write_text(owners_of(("00000000", 5006, os.geteuid())))
    with (tmp_path / table).open("a") as file:
        file.write(
            owners_of((address, 5006, 65534), ("00000000", 5007, 65534)).removeprefix(HEADING * (table == "udp"))
        )
    monkeypatch.setattr(datagrams, "TABLES", (tmp_path / "udp", tmp_path / "udp6"))
    assert "another user's program (uid 65534)" in Owners().why_not(5006, 0)


@pytest.mark.parametrize(("more", "why"), [(0, ""), (1, f"more than {MOST_SOCKETS} sockets")])
def test_table_with_too_many_sockets_refuses_all(
    more: int, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stranger could be among those that were not read."""
    (tmp_path / "udp").write_text(owners_of(*[("00000000", 5006, os.geteuid())] * (MOST_SOCKETS + more)))
    monkeypatch.setattr(datagrams, "TABLES", (tmp_path / "udp",))
    refused = Owners(lambda: 0).why_not(5006, 0)
    assert why in refused
    assert bool(refused) == bool(why)


def test_table_that_takes_too_long_refuses_all(sender: socket.socket) -> None:
    sender.bind(("0.0.0.0", 0))
    number, slow = sender.getsockname()[1], count(0, LONGEST_READ_NS + 1)
    assert "takes longer than" in Owners(lambda: next(slow)).why_not(number, 0)
    assert Owners(lambda: 0).why_not(number, 0) == ""


def test_table_that_cannot_be_read_refuses_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "udp").write_text(owners_of(("00000000", 5006, os.geteuid())))
    (tmp_path / "udp6").mkdir()
    monkeypatch.setattr(datagrams, "TABLES", (tmp_path / "udp", tmp_path / "udp6"))
    assert "cannot be used to see whose it is" in Owners().why_not(5006, 0)


def test_poll_that_takes_long_leaves_the_rest(port: int, sender: socket.socket) -> None:
    worked = count(0, LONGEST_POLL_NS // 8)
    lines = Datagrams(UdpGauge(port=port), lambda: next(worked))
    for number in range(20):
        sender.sendto(b"%d" % number, ("127.0.0.1", port))
    taken = lines.take(0)
    lines.close()
    assert 0 < len(taken) < 20


def test_other_port_than_the_configured_sender_is_not_read(port: int, sender: socket.socket) -> None:
    sender.bind(("0.0.0.0", 0))
    gauge = open_gauge(UdpGauge(port=port, sender=f"127.0.0.1:{sender.getsockname()[1]}"), None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(b"9.99", ("127.0.0.1", port))
        sender.sendto(b"0.5", ("127.0.0.1", port))
        assert forces(gauge) == [0.5]
    assert "collect.gauge.sender names another" in gauge.unread
    gauge.close()


def test_other_machine_than_the_configured_one_is_not_read(port: int, sender: socket.socket) -> None:
    gauge = open_gauge(UdpGauge(port=port, sender="192.0.2.7"), None)
    sender.sendto(b"9.99", ("127.0.0.1", port))
    assert forces(gauge) == []
    gauge.close()


def test_poll_reads_few_datagrams_and_leaves_the_rest(gauge: Gauge, port: int, sender: socket.socket) -> None:
    for number in range(NOT_MORE):
        sender.sendto(b"%d" % number, ("127.0.0.1", port))
    assert forces(gauge) == list(range(MOST_AT_ONCE))
    assert forces(gauge) == list(range(MOST_AT_ONCE, NOT_MORE))


def test_long_datagram_is_bounded(gauge: Gauge, port: int, sender: socket.socket) -> None:
    sender.sendto(b"1\n" * (LARGEST_DATAGRAM // 2), ("127.0.0.1", port))
    assert forces(gauge) == [1.0] * MOST_LINES
    sender.sendto(b"1" * 60000, ("127.0.0.1", port))
    assert forces(gauge) == []
    assert f"it is longer than {LARGEST_DATAGRAM} bytes" in gauge.unread


def flooded(gauge: Gauge, port: int, sender: socket.socket, now_ns: int) -> None:
    for _ in range(NOT_MORE):
        sender.sendto(b"1", ("127.0.0.1", port))
    gauge.poll(now_ns)


def test_flood_ends_the_work_with_its_sender(gauge: Gauge, port: int, sender: socket.socket) -> None:
    for share in (0.0, 0.5, 1.0):
        flooded(gauge, port, sender, round(share * FLOODED_NS))
    with pytest.raises(AbsentError, match=r"is flooded with datagrams, the last from 127\.0\.0\.1:\d+"):
        flooded(gauge, port, sender, round(1.1 * FLOODED_NS))


def test_backlog_after_a_pause_is_no_flood(gauge: Gauge, port: int, sender: socket.socket) -> None:
    """The process was not run for a while: a few polls are full, then one is not."""
    flooded(gauge, port, sender, 0)
    assert forces(gauge) != []
    for step in range(4):
        flooded(gauge, port, sender, FLOODED_NS * (1 + step))
        forces(gauge, FLOODED_NS * (1 + step))


class Empty:
    """A pad's feed without frames."""

    description, counts = "a board", None

    def poll(self, now_ns: int) -> list[Frame]:
        return []

    def board_uid(self) -> str:
        return ""

    def close(self) -> None:
        """Nothing is open."""


class Steps(Clock):
    """A clock that stands still between the test's own steps."""

    now = 0

    def now_ns(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)


def test_flood_under_a_rod_stops_the_press(gauge: Gauge, port: int, sender: socket.socket) -> None:
    """StoppedError lifts the rod: end_to_end/test_collect_faults.py."""
    clock = Steps()
    watch = Watch(Empty(), gauge, Limits(4.0, 1000.0), clock)
    watch.on_guard = True

    def turn() -> None:
        for _ in range(NOT_MORE):
            sender.sendto(b"1", ("127.0.0.1", port))
        watch.turn()
        clock.sleep(0.06)

    turn()
    turn()
    with pytest.raises(StoppedError, match="is flooded with datagrams"):
        turn()


@pytest.mark.parametrize(
    ("address", "sender", "why"),
    [
        ("127.0.0.1", "", ""),
        ("localhost", "", ""),
        ("127.0.0.1", "127.0.0.1:6000", ""),
        ("0.0.0.0", "192.168.1.20", ""),
        ("0.0.0.0", "", "must name the machine that sends"),
        ("192.168.1.5", "", "must name the machine that sends"),
        ("", "", "must name the machine that sends"),
        ("0.0.0.0", "gauge.local", "must be an IPv4 address"),
        ("0.0.0.0", "192.168.1.20:", "must be an IPv4 address"),
        ("0.0.0.0", "192.168.1.20:0x5", "must be an IPv4 address"),
        ("0.0.0.0", "192.168.1.20\n", "must be an IPv4 address"),
        ("0.0.0.0", "192.168.1.20:5\n", "must be an IPv4 address"),
    ],
)
def test_sender_is_required_where_the_network_reaches_the_port(address: str, sender: str, why: str) -> None:
    found = list(problems(CollectConfig(gauge=UdpGauge(port=5005, address=address, sender=sender))))
    assert [key for key, _ in found] == [("gauge", "sender")] * bool(why)
    assert all(why in text for _, text in found)
