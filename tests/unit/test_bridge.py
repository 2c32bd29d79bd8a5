"""The bridge on a real pty: opening, binding, configuring, losing the board and getting it back."""

from __future__ import annotations

import os
import time
import tty
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from emulator.board import UID, Board
from fmfts.config import BridgeSource, GeometryConfig, PadConfig
from fmfts.sensor.bridge.bridge import Bridge
from fmfts.sensor.chips import HMC5983
from fmfts.sensor.chips.recognised import why_not_among
from fmfts.sensor.source import SourceError
from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import SensorState, Verb
from fmfts.sensor.wired_pad import PadOnBoard
from fmfts.sources import on_board

PATIENCE_S = 60.0  # a limit for a busy machine; nothing here takes a second unless it says so


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    with plugged(tmp_path / "port") as board:
        yield board


@contextmanager
def plugged(port: Path, **options: object) -> Iterator[Board]:
    board = Board(port, **options)  # type: ignore[arg-type]
    yield board
    if board.link.is_symlink():
        board.unplug()


def pad(port: Path, name: str = "left", sensors: int = 4, **source: object) -> PadOnBoard:
    positions = tuple((float(i), 0.0, 0.0) for i in range(sensors))
    config = PadConfig(
        name=name,
        source=BridgeSource(port=str(port), **source),  # type: ignore[arg-type]
        geometry=GeometryConfig(sensors_mm=positions),
    )
    return on_board(config)


def run(bridge: Bridge, *boards: Board, until: Callable[[], object], frames: list | None = None) -> list:
    """Poll as the pipeline does, with the board answering in between; returns the frames as soon as they come."""
    frames = [] if frames is None else frames
    end = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < end, f"still waiting: {bridge.state}"
        for board in boards:
            board.serve()
        frames += bridge.poll(time.monotonic_ns())
        time.sleep(0.001)
    return frames


def connected(bridge: Bridge, board: Board) -> None:
    run(bridge, board, until=lambda: bridge.state.board and bridge._link.due_ns is None)
    board.requests.clear()


def test_opening_a_line_drops_only_older_bytes(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another program may hold this one up between the read and the look at the clock: what comes then is unread."""
    bridge, at_ns = Bridge({0: pad(board.link)}), [1_000_000_000]
    connected(bridge, board)

    def read(descriptor: int, size: int, read: Callable[[int, int], bytes] = os.read) -> bytes:
        data = read(descriptor, size)
        at_ns[0] += 50_000_000
        return data

    monkeypatch.setattr(bridge, "clock_ns", lambda: at_ns[0])
    monkeypatch.setattr("fmfts.sensor.bridge.bridge.os.read", read)
    board.send(board.sample())
    run(bridge, board, until=lambda: at_ns[0] > 1_000_000_000)
    assert bridge._clock.unread_ns(at_ns[0]) >= 50_000_000
    assert bridge.state.has_clock, "the board's, which may be what is late"


def test_frame_after_the_callers_clock_look_is_not_older(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    looked_ns, frames = time.monotonic_ns(), []
    board.send(board.sample())
    while not frames:
        time.sleep(0.001)
        frames += bridge.poll(looked_ns)
    assert frames[0].host_time_ns > looked_ns


def test_frames_arrive_with_their_numbers_and_time_not_in_future(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    board.time_us = 2**32
    board.send(board.sample(valid=0b1011, fresh=0b0001, age_us=np.array([0, 10, 65535, 4544], np.uint16)))
    arrived: list = []
    before_ns = time.monotonic_ns()
    run(bridge, board, until=lambda: arrived, frames=arrived)
    (frame,) = arrived
    assert frame.counts.tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]
    assert frame.valid.tolist() == [True, True, False, True]
    assert frame.fresh.tolist() == [True, False, False, False]
    assert frame.age_us.tolist() == [0, 10, 65535, 4544]
    assert (frame.device_time_us, frame.gain_code, frame.temperature_c) == (2**32, 3, 26.0)
    assert before_ns - 1_000_000_000 < frame.host_time_ns <= time.monotonic_ns()
    assert frame.counts.dtype == np.int16
    assert frame.age_us.dtype == np.uint16
    bridge.close()


def test_board_is_given_the_configs_settings_and_started(board: Board) -> None:
    board.running = 0
    bridge = Bridge({0: pad(board.link, rate_hz=100, range_gauss=4.0, trigger="simultaneous")})
    run(bridge, board, until=lambda: board.running)
    run(bridge, board, until=lambda: bridge._link.due_ns is None)
    assert (board.gain_code, board.rate_hz, board.trigger) == (4, 100, 1)
    shown = bridge.state.board
    assert (shown["range_gauss"], shown["rate_hz"], shown["trigger"]) == (4.0, 100, "simultaneous")
    order = [Verb(request.verb) for request in board.requests]
    assert order.index(Verb.RATE) < order.index(Verb.TRIGGER)  # 220 Hz are not possible when simultaneous
    assert order[-1] is Verb.START
    bridge.close()


def test_board_that_is_as_configured_is_left_alone(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    run(bridge, board, until=lambda: bridge.state.board)
    assert {request.verb for request in board.requests} == {Verb.HELLO}
    assert bridge.state.board["uid"] == UID.hex()
    bridge.close()


def test_board_that_was_reset_is_configured_again(board: Board) -> None:
    bridge = Bridge({0: pad(board.link, rate_hz=50)})
    connected(bridge, board)
    assert board.rate_hz == 50
    board.rate_hz = 220
    board.send(board.hello())
    run(bridge, board, until=lambda: board.rate_hz == 50)
    bridge.close()


def test_unanswered_request_is_repeated_under_its_number(board: Board) -> None:
    board.deaf = True
    bridge = Bridge({0: pad(board.link)})
    start = time.monotonic()
    run(bridge, board, until=lambda: len(board.requests) >= 3)
    assert time.monotonic() - start > 0.45  # two pauses of 250 ms, less the first poll's delay
    assert len({request.request_id for request in board.requests}) == 1
    board.deaf = False
    run(bridge, board, until=lambda: bridge.state.board)
    bridge.close()


def test_board_that_sends_but_never_answers_is_named(board: Board) -> None:
    board.deaf = True
    bridge = Bridge({0: pad(board.link)})
    stream = iter(lambda: board.stream() or bridge.state.warnings, None)
    run(bridge, board, until=lambda: next(stream))
    assert "check the line from host to board" in bridge.state.warnings["requests"]
    assert bridge.state.connected
    bridge.close()


def test_errors_are_counted_and_good_frames_go_on(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    board.stream(3)
    board.sequence[0] += 5
    board.stream(1)
    damaged = bytearray(encode(board.sample()))
    damaged[20] ^= 0x10
    os.write(board.master, bytes(damaged))
    os.write(board.master, b"\x05garbage\0")
    board.stream(1)
    frames: list = []
    run(bridge, board, until=lambda: len(frames) == 5, frames=frames)
    assert [frame.sequence for frame in frames] == [0, 1, 2, 8, 10]
    assert bridge.state.crc_errors == 1
    assert bridge.state.garbage_bytes == 8
    bridge.close()


def test_silent_board_is_disconnected_and_asked_until_it_speaks(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    bridge.poll(time.monotonic_ns() + 2_000_000_000)
    assert not bridge.state.connected
    assert bridge.state.reason.startswith("the port is open but silent for ")
    run(bridge, board, until=lambda: bridge.state.connected)
    assert board.requests[0].verb == Verb.HELLO
    bridge.close()


@pytest.mark.parametrize("bound", [False, True])
@pytest.mark.parametrize(
    ("sent", "shown"),
    [
        (b"$GPGGA,123519,4807.038,N\r\n" * 3, r"'$GPGGA,123519,4807.038,N'"),
        (bytes(range(0x80, 0xD0)), "80 81 82"),
    ],
    ids=["text", "bytes"],
)
def test_bytes_that_form_no_packet_are_shown(
    tmp_path: Path, bound: bool, sent: bytes, shown: str, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    bridge = Bridge({0: pad(Path(os.ttyname(theirs)), **({"uid": "ab" * 12} if bound else {}))}, tmp_path)
    try:
        begun_ns = time.monotonic_ns()
        bridge.poll(begun_ns)
        for _ in range(10):
            os.write(ours, sent)
            bridge.poll(begun_ns)
        bridge.poll(begun_ns + 1_600_000_000)
        assert not bridge.state.connected
        reason = bridge.state.reason
        assert f"{10 * len(sent)} bytes came in 1.6 s, but no packet; they begin with {shown}" in reason
        assert "wrong baud (it is 460800), or another device?" in reason
        assert bridge.state.garbage_bytes > 0
        assert [record.message for record in caplog.records if "but no packet" in record.message]
    finally:
        bridge.close()
        os.close(ours)
        os.close(theirs)


@pytest.mark.parametrize("bound", [False, True])
def test_board_of_another_wire_version_is_not_called_silent(board: Board, bound: bool) -> None:
    foreign = b"\x04\x21" + crc_hqx(b"\x21", 0xFFFF).to_bytes(2, "little") + b"\0"
    bridge = Bridge({0: pad(board.link, uid=UID.hex() if bound else None)}, board.link.parent / "by-id")
    board.deaf = True
    now_ns = time.monotonic_ns()
    bridge.poll(now_ns)
    os.write(board.master, b"\0" + foreign)
    bridge.poll(now_ns + 1_000_000)
    bridge.poll(now_ns + 2_000_000_000)
    assert "speaks wire version 2, this daemon 1: update the daemon" in bridge.state.reason
    assert "silent" not in bridge.state.reason
    bridge.close()


def test_one_board_serves_several_pads_and_ignores_those_not_configured(tmp_path: Path) -> None:
    with plugged(tmp_path / "port", pads=3) as board:
        bridge = Bridge({0: pad(board.link, "left"), 2: pad(board.link, "right", pad_index=2)})
        connected(bridge, board)
        frames: list = []
        # It keeps streaming: if this computer is delayed, the bridge opens the port anew, and earlier bytes are lost.
        run(bridge, board, until=lambda: board.stream(1) or len(frames) >= 8, frames=frames)
        assert {frame.pad_index for frame in frames} == {0, 2}
        assert len({(frame.pad_index, frame.sequence) for frame in frames}) == len(frames), "one came twice"
        bridge.close()


def test_sensor_faults_are_sentences_and_go_when_mended(board: Board) -> None:
    board.states[0][2] = SensorState.NO_ANSWER
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    assert bridge.state.sensor_faults == {
        (0, 2): "sensor 3 (mux 0x70, channel 2) does not answer at 0x1E: check SDA/SCL of that channel"
    }
    for state in list(SensorState)[1:]:
        board.states[0][2] = state
        board.send(board.status())
        run(bridge, board, until=lambda: bridge.poll(time.monotonic_ns()) == [] or True)
        assert (0, 2) in bridge.state.sensor_faults
    board.states[0][2] = SensorState.OK
    board.send(board.status())
    run(bridge, board, until=lambda: not bridge.state.sensor_faults)
    bridge.close()


def test_wrong_chip_is_named_by_what_it_answers(board: Board) -> None:
    board.states[0][0] = SensorState.WRONG_IDENTIFICATION
    board.identification = b"H44"
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    assert "answers 48 34 34" in bridge.state.sensor_faults[0, 0]
    bridge.close()


def test_pad_of_other_chips_is_not_read(board: Board) -> None:
    board.identification = b"\x30\x00\x00"
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    said = 'is an MMC5983MA at 0x30, not an HMC5983: set chip = "mmc5983ma"'
    assert bridge.state.pad_faults[0] == f"pad 'left': sensor 1 (mux 0x70, channel 0) {said}"
    board.stream(5)
    assert run(bridge, board, until=lambda: bridge._link.heard_ns > 0) == []
    assert 0 in bridge.state.pad_faults
    bridge.close()


def test_odd_chip_among_right_ones_is_named_for_replacement() -> None:
    answers = [b"H43", b"\0\0\0", b"\x30\0\0", b"H43"]
    sensor, said = why_not_among(HMC5983, answers) or (-1, "")
    assert sensor == 2
    assert said == "is an MMC5983MA at 0x30, not an HMC5983: a pad's chips must be of one kind: fit another one there"
    assert why_not_among(HMC5983, answers[:2]) is None


def test_another_number_of_sensors_is_refused_with_both_numbers(board: Board) -> None:
    bridge = Bridge({0: pad(board.link, sensors=3)})
    connected(bridge, board)
    assert "the source has 4 sensors, geometry.sensors_mm has 3" in bridge.state.pad_faults[0]
    board.stream(5)
    frames = run(bridge, board, until=lambda: bridge._link.heard_ns > 0)
    assert frames == []
    bridge.close()


def test_pad_that_the_board_lacks_is_named(board: Board) -> None:
    bridge = Bridge({1: pad(board.link, pad_index=1)})
    connected(bridge, board)
    wants = "the board has 1 pad, pad 'left' wants pad_index = 1 (they count from 0): correct the config"
    assert bridge.state.pad_faults == {1: wants}
    bridge.close()


def test_selftest_brings_counts_and_gain_factors(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    with pytest.raises(SourceError, match="no self-test"):
        bridge.request_selftest(0)
    connected(bridge, board)
    bridge.request_selftest(0)
    assert bridge.selftest_result(0) is None
    with pytest.raises(SourceError, match="running already"):
        bridge.request_selftest(0)
    run(bridge, board, until=lambda: bridge.selftest_result(0))
    result = bridge.selftest_result(0)
    assert result is not None
    assert result["passed"] is True
    assert result["sensors"][0]["gain_factor"] == pytest.approx([1.0, 1.0, 1.0], abs=1e-3)  # 452/(1.16 G · 390/G)
    bridge.close()


def test_selftest_ends_when_the_board_refuses_or_goes(board: Board) -> None:
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    board.result = 4
    bridge.request_selftest(0)
    run(bridge, board, until=lambda: bridge.selftest_result(0))
    assert "busy" in str(bridge.selftest_result(0))
    board.deaf = True
    bridge.request_selftest(0)
    board.unplug()
    run(bridge, until=lambda: bridge.selftest_result(0))
    assert "plug the board in again" in str(bridge.selftest_result(0))
    bridge.close()
