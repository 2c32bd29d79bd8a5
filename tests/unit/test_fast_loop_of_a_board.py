"""A daemon and its board: frames that C handles, which of them are reported, and what ends this."""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fast_loop_host import sample_of
from pad_frames import frames_of
from test_bridge import plugged
from test_pipeline import config_of

from emulator.board import Board
from fmfts import baseline as baselines
from fmfts.config import BridgeSource, BusConfig, Config
from fmfts.runtime.daemon import Daemon
from fmfts.sensor import Frame
from fmfts.sensor.wire.framing import encode
from fmfts_client import Message, Subscription
from fmfts_simulation.baseline import simulated_baseline

PATIENCE_S = 60.0
SECONDS = 2.0
PERIOD_S = 1 / 220


class Streaming:
    """A board that sends a pad's frames in their time, and answers."""

    def __init__(
        self, board: Board, left_out: Callable[[int], bool] = lambda number: False, from_s: float = 0.0
    ) -> None:
        """from_s: in the script of the simulated finger, which touches after four seconds."""
        self.sent = 0
        self._left_out = left_out
        self._board = board
        frames = frames_of(config_of(4), from_s + SECONDS)
        self.lines = [encode(sample_of(frame)) for frame in frames[round(from_s * 220) :]]
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Streaming:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()

    @property
    def is_over(self) -> bool:
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._board.running or not self._board.requests:
            if self._stopping.wait(0.01):
                return
            self._board.serve()
        begun = time.monotonic()
        for number, line in enumerate(self.lines):
            if self._stopping.wait(max(begun + number * PERIOD_S - time.monotonic(), 0.0)):
                return
            self._board.serve()
            if not self._left_out(number):
                os.write(self._board.master, line)
                self.sent += 1


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    with plugged(tmp_path / "port") as board:
        yield board


@pytest.fixture
def daemon(tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch) -> Iterator[Daemon]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with serving(board, tmp_path, ["left"]) as daemon:
        yield daemon


def serving(board: Board, folder: Path, names: list[str]) -> Daemon:
    """Pads of one board, all made alike, with baselines."""
    simulated, pads = config_of(4), []
    (folder / "fmfts" / "baseline").mkdir(parents=True)
    for index, name in enumerate(names):
        source = BridgeSource(port=str(board.link), pad_index=index)
        pads.append(msgspec.structs.replace(simulated, name=name, source=source))
        baseline = msgspec.structs.replace(simulated_baseline(simulated), pad=name).sealed()
        (folder / "fmfts" / "baseline" / f"{name}.json").write_bytes(baselines.encode(baseline))
    return Daemon(Config(pad=tuple(pads), bus=BusConfig(endpoint=f"ipc://{folder}")))


def run(daemon: Daemon, until: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < end, "it never happened"
        daemon._turn()


def test_frames_pass_without_python_and_all_are_published(
    daemon: Daemon, board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (channel,) = daemon._channels.values()
    in_python = Counter[str]()
    serve = daemon._serve
    monkeypatch.setattr(daemon, "_serve", lambda *a: in_python.update(["served"]) or serve(*a))
    with Subscription(("contact",), "left", f"ipc://{tmp_path}") as subscription, Streaming(board) as streaming:
        run(daemon, lambda: streaming.is_over)
        run(daemon, lambda: channel._statistics.frames == streaming.sent)
        heard: list[dict[str, Any]] = []
        run(daemon, lambda: (heard.extend(received(subscription)) or heard) and heard[-1]["health"] == "stale")
    healthy = [body for body in heard if body["health"] == "ok"]
    left_out = channel._statistics.dropped  # none, unless the computer was busy
    in_time = streaming.sent - left_out
    assert len(healthy) > 0.9 * in_time
    assert in_time > 0.5 * streaming.sent
    numbers = [body["seq"] for body in heard]
    assert all(later > earlier for earlier, later in pairwise(numbers))
    # Numbers follow each other, whichever code gave them; a message that was late when it was made keeps its number.
    assert numbers[-1] - numbers[0] + 1 - len(numbers) <= left_out
    assert channel._statistics.gaps == 0
    assert in_python["served"] < 0.3 * streaming.sent
    times = [body["t_sample_ns"] for body in healthy]
    assert all(later > earlier for earlier, later in pairwise(times))


@pytest.mark.real_time  # a gap within frames that a busy computer left out cannot be counted
def test_gaps_are_counted_wherever_frames_pass(daemon: Daemon, board: Board) -> None:
    (channel,) = daemon._channels.values()
    with Streaming(board, left_out=lambda number: number % 50 in (30, 31)) as streaming:
        run(daemon, lambda: streaming.is_over)
        run(daemon, lambda: channel._statistics.frames == streaming.sent)
    assert channel._statistics.gaps == sum(1 for number in range(round(SECONDS * 220)) if number % 50 in (30, 31))


def test_garbage_without_end_does_not_keep_port_from_being_read(daemon: Daemon, board: Board) -> None:
    (channel,) = daemon._channels.values()
    with Streaming(board, left_out=lambda number: number >= 200) as streaming:
        run(daemon, lambda: channel._statistics.frames == streaming.sent == 200)
        os.write(board.master, b"U" * 300)
        end = time.monotonic() + 0.1
        assert turns_until(daemon, lambda: time.monotonic() > end) < 20
        os.write(board.master, b"\0" + streaming.lines[200])
        assert turns_until(daemon, lambda: channel._statistics.frames == 201) < 5
        assert daemon._sources[0].state.garbage_bytes == 300


def test_plug_that_is_pulled_amid_a_packet_is_noticed_at_once(daemon: Daemon, board: Board) -> None:
    (channel,) = daemon._channels.values()
    with Streaming(board, left_out=lambda number: number >= 200) as streaming:
        run(daemon, lambda: channel._statistics.frames == streaming.sent == 200)
        os.write(board.master, streaming.lines[200][:20])
        board.unplug()
        assert turns_until(daemon, lambda: not daemon._sources[0].state.connected) < 10


def test_new_baseline_is_used_from_the_next_message_on(daemon: Daemon, board: Board, tmp_path: Path) -> None:
    """One that was restored, which does not need frames: they pass meanwhile."""
    (channel,) = daemon._channels.values()
    other = simulated_baseline(config_of(5))
    used: list[int] = []

    class Restored:
        """A task that has ended, as Verbs sees it: the baseline comes into use when it settles."""

        pad, task = "left", object()

        def settle(self, _: float) -> bool:
            channel.use(other)
            used.append(channel.pipeline.messages)
            return True

    with Subscription(("contact",), "left", f"ipc://{tmp_path}") as subscription, Streaming(board) as streaming:
        run(daemon, lambda: channel._statistics.frames > 150)
        daemon._verbs._pending.append(Restored())  # type: ignore[arg-type]
        run(daemon, lambda: streaming.is_over)
        heard = received(subscription)
    later = [body["baseline"] for body in heard if body["seq"] > used[0]]
    assert len(later) > 20
    assert set(later) == {other.id}


@pytest.mark.real_time  # C hands over late frames: on a busy computer Python may see the beginning of the touch
def test_touch_begun_in_c_is_reported_at_once(
    daemon: Daemon, board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the events for which C calls Python, and neither by a status nor by the check for silence."""
    (channel,) = daemon._channels.values()
    monkeypatch.setattr(daemon, "_tell_silence", lambda now_ns: False)
    daemon._status_ns = 1 << 62
    with (
        Subscription(("contact", "event"), "left", f"ipc://{tmp_path}") as subscription,
        Streaming(board, from_s=3.0) as streaming,
    ):
        run(daemon, lambda: channel._statistics.frames > 2)
        in_python = channel.frame
        began_in_python: list[bool] = []

        def judge(frame: Frame, **how: bool) -> None:
            before = channel.announcer.is_touched
            in_python(frame, **how)
            began_in_python.append(channel.announcer.is_touched and not before)

        monkeypatch.setattr(channel, "frame", judge)
        heard: list[Message] = []
        run(daemon, lambda: heard.extend(messages(subscription)) or streaming.is_over)
    touched = [one.body for one in heard if one.kind == "contact" and one.body["contact"]]
    (onset, *_) = [one.body for one in heard if one.kind == "event" and one.body["kind"] == "onset"]
    assert not any(began_in_python)
    assert touched[0]["t_publish_ns"] < onset["t_ns"] < touched[-1]["t_publish_ns"]
    assert f"{touched[0]['force_n']:.3f} N" in onset["detail"]


def test_statuses_stay_a_second_apart_after_delays(daemon: Daemon, board: Board, tmp_path: Path) -> None:
    """Earlier, a burst of a few milliseconds would count as the rate."""
    with Subscription(("status",), "left", f"ipc://{tmp_path}") as subscription:
        told: list[dict[str, Any]] = []
        run(daemon, lambda: (told.extend(received(subscription)) or told) and len(told) > 1)
        time.sleep(2.2)
        run(daemon, lambda: told.extend(received(subscription)) or len(told) > 4)
    times = [body["t_publish_ns"] for body in told[1:]]
    assert all(later - earlier > 900_000_000 for earlier, later in pairwise(times))


def test_two_pads_of_a_board_pass_or_fail_independently(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with plugged(tmp_path / "port", pads=2) as board, serving(board, tmp_path, ["left", "right"]) as daemon:
        streaming = Streaming(board)
        for number, frame in enumerate(frames_of(config_of(4), SECONDS)):
            sample = sample_of(frame)
            counts = sample.counts.copy()
            counts[0] += 300 * (150 <= number < 250)  # 0.3 G at one sensor of one pad, which no magnet causes
            streaming.lines[number] += encode(msgspec.structs.replace(sample, pad_index=1, counts=counts))
        left, right = daemon._channels.values()
        healths: set[str] = set()
        with streaming:
            run(daemon, lambda: left._statistics.frames > 160)
            run(daemon, lambda: healths.update((left.health + " left", right.health + " right")) or streaming.is_over)
            run(daemon, lambda: left._statistics.frames == right._statistics.frames == streaming.sent)
        assert "ok left" in healths
        assert healths & {"degraded right", "disturbed right", "lost right"}
        assert not healths & {"degraded left", "disturbed left", "lost left"}
        assert left._statistics.gaps == right._statistics.gaps == 0


def turns_until(daemon: Daemon, condition: Callable[[], object]) -> int:
    turns, end = 0, time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it never happened"
        daemon._turn()
        turns += 1
    return turns


def messages(subscription: Subscription) -> list[Message]:
    found = []
    while (message := subscription.receive(0.0)) is not None:
        found.append(message)
    return found


def received(subscription: Subscription) -> list[dict[str, Any]]:
    return [message.body for message in messages(subscription)]


def test_recorder_gets_every_frame_from_its_start(daemon: Daemon, board: Board, tmp_path: Path) -> None:
    (channel,) = daemon._channels.values()
    with Streaming(board) as streaming:
        run(daemon, lambda: channel._statistics.frames > 100)
        with Subscription(("frame",), "left", f"ipc://{tmp_path}") as recorder:
            sequences: list[int] = []

            def record() -> None:
                while (message := recorder.receive(0.0)) is not None:
                    sequences.append(message.body["sequence"])

            run(daemon, lambda: record() or streaming.is_over)
            run(daemon, lambda: record() or (sequences and sequences[-1] == streaming.sent - 1))
    assert len(sequences) > 100
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
