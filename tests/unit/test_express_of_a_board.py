"""A daemon and its board: frames that pass in C, what is told of them, and what ends it."""

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
from test_bridge import plugged
from test_express import sample_of
from test_healthy_path import frames_of
from test_pipeline import config_of

from emulator.board import Board
from fmfts import ambient
from fmfts.config import BridgeSource, BusConfig, Config
from fmfts.healthy.compiled import AVAILABLE
from fmfts.jobs.simulated_baseline import simulated_baseline
from fmfts.running.daemon import Daemon
from fmfts.sensor.framing import encode
from fmfts_client import Subscription

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="the healthy path was not compiled")

PATIENCE_S = 20.0
SECONDS = 2.0
PERIOD_S = 1 / 220


class Streaming:
    """A board that sends a pad's frames in their time, and answers."""

    def __init__(self, board: Board) -> None:
        self.sent = 0
        self._board = board
        self._lines = [encode(sample_of(frame)) for frame in frames_of(config_of(4), SECONDS)]
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
        for number, line in enumerate(self._lines):
            if self._stopping.wait(max(begun + number * PERIOD_S - time.monotonic(), 0.0)):
                return
            self._board.serve()
            os.write(self._board.master, line)
            self.sent += 1


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    with plugged(tmp_path / "port") as board:
        yield board


@pytest.fixture
def daemon(tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch) -> Iterator[Daemon]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    simulated = config_of(4)
    folder = tmp_path / "fmfts" / "baseline"
    folder.mkdir(parents=True)
    (folder / "left.json").write_bytes(ambient.encode(simulated_baseline(simulated)))
    config = msgspec.structs.replace(simulated, source=BridgeSource(port=str(board.link)))
    with Daemon(Config(pad=(config,), bus=BusConfig(endpoint=f"ipc://{tmp_path}"))) as daemon:
        yield daemon


def run(daemon: Daemon, until: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < end, "it never happened"
        daemon._turn()


def test_frames_pass_without_python_and_all_of_them_are_told(
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
    assert len(healthy) > 0.9 * streaming.sent
    numbers = [body["seq"] for body in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "one number after the other, whoever gave it"
    assert channel._statistics.gaps == 0
    assert in_python["served"] < 0.3 * streaming.sent
    times = [body["t_sample_ns"] for body in healthy]
    assert all(later > earlier for earlier, later in pairwise(times))


def received(subscription: Subscription) -> list[dict[str, Any]]:
    found = []
    while (message := subscription.receive(0.0)) is not None:
        found.append(message.body)
    return found


def test_who_records_gets_every_frame_from_then_on(daemon: Daemon, board: Board, tmp_path: Path) -> None:
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
