"""The port of a bridge: absent, unplugged, another device's, silent, bound to a board, or in use by another program."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_bridge import connected, pad, plugged, run

from emulator.board import UID, Board
from fmfts.sensor.bridge.bridge import Bridge
from fmfts.sensor.bridge.serial_port import why_not_open


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    with plugged(tmp_path / "port") as board:
        yield board


def test_absent_port_is_named_and_found_when_it_appears(tmp_path: Path) -> None:
    bridge = Bridge({0: pad(tmp_path / "port")})
    bridge.poll(time.monotonic_ns())
    assert not bridge.state.connected
    assert bridge.state.description == f"bridge on {tmp_path / 'port'}"
    assert bridge.state.reason == "the port does not exist (is the board plugged in?)"
    assert bridge.fileno() is None
    with plugged(tmp_path / "port") as board:
        run(bridge, board, until=lambda: bridge.state.connected)
        assert bridge.state.reconnects == 0
    bridge.close()


def test_unplugging_closes_the_descriptor_says_why_and_reopens(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    for again in range(1, 4):
        descriptor = bridge.fileno()
        assert descriptor is not None
        board.unplug()
        run(bridge, until=lambda: not bridge.state.connected)
        assert bridge.state.reason.startswith("the port ")
        assert ": " not in bridge.state.reason, "log and page put pad and health before it, with a colon each"
        assert str(board.link) not in bridge.state.reason  # the description has it already
        assert bridge.fileno() is None
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)
        lost_ns = bridge.state.since_ns
        board.plug()
        board.sequence[0] += 100
        run(bridge, board, until=lambda: bridge.state.connected)
        assert 0 < lost_ns < bridge.state.since_ns <= time.monotonic_ns()
        assert bridge.state.reconnects == again
    bridge.close()


def test_backoff_never_exceeds_a_second(tmp_path: Path) -> None:
    bridge = Bridge({0: pad(tmp_path / "port")})
    now_ns = 0
    for _ in range(20):
        bridge.poll(now_ns)
        deadline_ns = bridge.deadline_ns()
        assert deadline_ns is not None
        assert 0 < deadline_ns - now_ns <= 1_000_000_000
        now_ns = deadline_ns
    assert deadline_ns - now_ns == 0


def test_replugged_board_is_opened_at_once(tmp_path: Path) -> None:
    bridge = Bridge({0: pad(tmp_path / "port")})
    now_ns = 0
    while now_ns < 10_000_000_000:
        bridge.poll(now_ns)
        now_ns = bridge.deadline_ns() or 0
    with plugged(tmp_path / "port"):
        bridge.poll(now_ns)
        assert bridge.fileno() is not None
        bridge.close()


def test_port_whose_name_moved_to_a_board_is_left_at_once(tmp_path: Path) -> None:
    """A port's number may be reused: between two plugs it may have belonged to another device."""
    port = tmp_path / "port"
    with plugged(tmp_path / "other") as other, plugged(tmp_path / "again") as board:
        port.symlink_to(os.readlink(other.link))
        bridge = Bridge({0: pad(port)})
        start_ns = now_ns = time.monotonic_ns()
        bridge.poll(now_ns)
        assert bridge.fileno() is not None
        port.unlink()
        port.symlink_to(os.readlink(board.link))
        while not bridge.state.connected:
            now_ns = bridge.deadline_ns() or now_ns
            assert now_ns - start_ns < 1_000_000_000, bridge.state
            bridge.poll(now_ns)
            board.serve()
        bridge.close()


def test_forbidden_port_is_tried_at_most_once_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    attempts = []
    (tmp_path / "port").touch(mode=0)

    def refused(*_: object, **__: object) -> None:
        attempts.append(now_ns)
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("fmfts.sensor.bridge.serial_port.serial.Serial", refused)
    bridge = Bridge({0: pad(tmp_path / "port")})
    now_ns = 0
    while now_ns < 20_000_000_000:
        bridge.poll(now_ns)
        now_ns = bridge.deadline_ns() or 0
    assert 20 <= len(attempts) <= 26
    (tmp_path / "port").chmod(0o600)
    bridge.poll(now_ns)
    assert attempts[-1] == now_ns, "udev has set the group: no reason to wait"


@pytest.mark.parametrize("kind", ["/dev/null", "file", "folder"])
def test_device_that_is_no_serial_port_is_refused(tmp_path: Path, kind: str) -> None:
    (tmp_path / "file").write_text("not a port")
    (tmp_path / "folder").mkdir()
    bridge = Bridge({0: pad(tmp_path / kind)})  # an absolute path stays unchanged
    bridge.poll(time.monotonic_ns())
    assert bridge.state.reason == "the port is not a serial port: see /dev/serial/by-id for those that are"
    bridge.close()


def test_bound_board_is_found_on_another_port(board: Board, tmp_path: Path) -> None:
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    with plugged(by_id / "moved", uid=b"R" * 12) as right:
        bridge = Bridge({0: pad(board.link, uid=(b"R" * 12).hex())}, by_id)
        stream = iter(lambda: right.stream() or board.stream() or bridge.state.connected, None)
        frames = run(bridge, board, right, until=lambda: next(stream))
        assert bridge.state.description == f"bridge on {by_id / 'moved'}"
        assert bridge.state.board["uid"] == (b"R" * 12).hex()
        assert frames == [] or {frame.sequence for frame in frames} <= set(range(right.sequence[0]))
        bridge.close()


def test_absent_board_gives_no_frame_and_lists_what_was_found(board: Board, tmp_path: Path) -> None:
    wanted = b"W" * 12
    bridge = Bridge({0: pad(board.link, uid=wanted.hex())}, tmp_path / "by-id")
    stream = iter(lambda: board.stream() or "not found" in bridge.state.reason, None)
    frames = run(bridge, board, until=lambda: next(stream))
    assert frames == []
    assert bridge.state.reason == f"board {wanted.hex()} was not found, because {board.link} holds board {UID.hex()}"
    bridge.close()


def test_nothing_is_written_to_a_port_without_our_protocol(tmp_path: Path) -> None:
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    with plugged(by_id / "somebody-elses-robot") as stranger:
        bridge = Bridge({0: pad(tmp_path / "port", uid="00" * 12)}, by_id)
        run(bridge, until=lambda: "not found" in bridge.state.reason)
        with pytest.raises(OSError):  # noqa: PT011 — EAGAIN or EIO, both mean that no byte ever came
            os.read(stranger.master, 100)
        assert "somebody-elses-robot holds no board that answers" in bridge.state.reason
        bridge.close()


def test_second_process_is_refused_with_the_firsts_pid(board: Board) -> None:
    hold = f"import serial; port = serial.Serial({str(board.link)!r}, exclusive=True); print(1, flush=True); input()"
    command = [sys.executable, "-c", hold]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert holder.stdout
    holder.stdout.readline()
    bridge = Bridge({0: pad(board.link)})
    bridge.poll(time.monotonic_ns())
    assert f"is in use by process {holder.pid} (" in bridge.state.reason
    holder.communicate(b"\n")
    run(bridge, board, until=lambda: bridge.state.connected)
    bridge.close()


def test_closed_bridge_stays_closed(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    bridge.close()
    bridge.close()
    assert list(bridge.poll(time.monotonic_ns())) == []
    assert bridge.fileno() is None


def test_port_without_permission_says_how_to_get_it() -> None:
    text = why_not_open("/dev/ttyUSB0", PermissionError(errno.EACCES, "Permission denied"))
    assert text.startswith("is there, but you may not open it: `sudo usermod -aG dialout $USER`")
    assert text.endswith("then log in again")
