"""A daemon that was late: it goes on with the newest frames, counts what it left out, and is not late any longer."""

from __future__ import annotations

import os
import re
import select
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from fast_loop_host import Host, sample_of
from hypothesis import given, settings
from hypothesis import strategies as st
from pad_frames import frames_of
from test_fast_loop import bus  # noqa: F401  (a fixture)
from test_fast_loop_of_a_board import Streaming, board, daemon, received, run  # noqa: F401  (fixtures)
from test_link import hello
from test_pipeline import config_of
from wire_packets import make_early

from emulator.board import Board
from examples import examples
from fmfts.config import Config, PadConfig, SimulatedSource
from fmfts.pipeline import _pad
from fmfts.runtime.daemon import SILENT_AT_ONCE, Daemon
from fmfts.runtime.lateness import OVERDUE_NS
from fmfts.sensor.patience import BEHIND, IN_TIME, Patience
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.newest import _wire, keep_newest
from fmfts.sensor.wire.packets import Sample
from fmfts_client import Subscription
from fmfts_simulation.baseline import simulated_baseline
from twins.newest import keep_newest as one_by_one

STALL_S = 0.5
PERIOD_US = 4545


def sample(pad_index: int, number: int, time_us: int) -> bytes:
    counts, age_us = np.zeros((4, 3), np.int16), np.zeros(4, np.uint16)
    return encode(Sample(pad_index, number, time_us, 5, 0, 15, 15, 0, counts, age_us))


def numbers(data: bytes) -> list[tuple[int, int]]:
    """The pad index and the sequence of the samples in these bytes."""
    return [(one.pad_index, one.sequence) for one in Decoder().feed(data) if isinstance(one, Sample)]


def test_newest_frames_of_a_backlog_stay_evenly_over_the_pads() -> None:
    backlog = b"".join(sample(pad, number, number * PERIOD_US) for number in range(60) for pad in range(3))
    for patience, kept in ((IN_TIME, range(56, 60)), (BEHIND, range(59, 60))):  # four frames are within 15 ms
        data, left_out = keep_newest(backlog, patience)
        assert numbers(data) == [(pad, number) for number in kept for pad in range(3)]
        assert left_out == (60 - len(kept),) * 3


def test_other_bytes_keep_their_order() -> None:
    others = [encode(hello(4)), b"\x05garbage\0", sample(0, 0, 0)[:-5] + b"\0", b"\0"]
    old, new, beginning = sample(0, 1, 0), sample(0, 2, 100_000), sample(0, 3, 104_545)[:20]
    data, left_out = keep_newest(others[0] + old + others[1] + old + others[2] + others[3] + new + beginning, IN_TIME)
    assert data == b"".join(others) + new + beginning
    assert left_out == (2, 0, 0)


@pytest.mark.parametrize("patience", [IN_TIME, BEHIND])
def test_old_sample_that_was_sent_again_supersedes_nothing(patience: Patience) -> None:
    new = sample(0, 300, 300 * PERIOD_US)
    data, left_out = keep_newest(new + sample(0, 80, 80 * PERIOD_US), patience)
    assert numbers(data) == [(0, 300), (0, 80)]
    assert left_out == (0, 0, 0)


@pytest.mark.parametrize(("patience", "kept"), [(IN_TIME, range(56, 60)), (BEHIND, range(59, 60))])
def test_old_sample_that_was_sent_again_keeps_no_backlog(patience: Patience, kept: range) -> None:
    backlog = b"".join(sample(0, number, number * PERIOD_US) for number in range(60))
    data, left_out = keep_newest(backlog + sample(0, 10, 10 * PERIOD_US), patience)
    assert numbers(data) == [*((0, number) for number in kept), (0, 10)]
    assert left_out == (60 - len(kept), 0, 0)


def early(sensor: int, time_us: int, pad_index: int = 0) -> bytes:
    return encode(make_early(sensor, time_us, pad_index=pad_index))


def test_late_daemon_keeps_only_each_sensors_newest_early_sample() -> None:
    before = [early(sensor, 1000 * sensor) for sensor in range(4)]
    after = [early(sensor, 5000 + 1000 * sensor) for sensor in (0, 1)]
    again = early(0, 9545)
    frame = sample(0, 1, 4000)
    data, left_out = keep_newest(b"".join([*before, frame, *after, again]), BEHIND)
    assert data == frame + after[1] + again
    assert left_out == (0, 0, 0)  # nothing is lost: the next frame contains the dropped samples


def test_in_time_early_samples_of_the_last_15_ms_stay() -> None:
    lines = [early(0, number * PERIOD_US) for number in range(10)]
    data, left_out = keep_newest(b"".join(lines) + early(1, 0, pad_index=1), IN_TIME)
    assert data == b"".join(lines[6:]) + early(1, 0, pad_index=1)
    assert left_out == (0, 0, 0)


PIECES = st.one_of(
    st.builds(early, st.integers(0, 7), st.integers(0, 60_000), st.integers(0, 4)),
    st.builds(sample, st.integers(0, 4), st.integers(0, 2**32 - 1), st.integers(0, 60_000)),
    st.builds(lambda line, at: line[:at] + line[at + 1 :], st.just(sample(0, 1, 1)), st.integers(0, 50)),
    st.binary(max_size=30),
    st.just(encode(hello(4))),
)


@given(st.lists(PIECES, max_size=30), st.sampled_from([IN_TIME, BEHIND, Patience(2, 30_000)]))
@settings(examples(200))
def test_c_and_python_drop_the_same_frames(pieces: list[bytes], patience: Patience) -> None:
    data = b"".join(pieces)
    assert _wire.keep_newest(data, *patience) == one_by_one(data, patience)


def test_frames_during_a_stall_are_dropped_and_counted(
    daemon: Daemon,  # noqa: F811
    board: Board,  # noqa: F811
    tmp_path: Path,
) -> None:
    (channel,) = daemon._channels.values()
    with (
        Subscription(("contact", "status"), "left", f"ipc://{tmp_path}") as subscription,
        Streaming(board) as streaming,
    ):
        run(daemon, lambda: channel._statistics.frames > 150)
        before = channel._statistics.dropped
        time.sleep(STALL_S)  # the backlog waits in the pty
        run(daemon, lambda: streaming.is_over)
        run(daemon, lambda: channel._statistics.frames == streaming.sent)
        heard = received(subscription)
    healthy = [body for body in heard if body["health"] == "ok" and "seq" in body]
    assert max(body["t_publish_ns"] - body["t_sample_ns"] for body in healthy) < OVERDUE_NS + 2e9 / 220
    assert channel._statistics.dropped - before > 0.7 * STALL_S * 220
    assert channel._statistics.gaps == 0
    told = [body["reason"] for body in heard if "overloaded" in body.get("reason", "")]
    assert re.fullmatch(r"this computer is overloaded: \d+ % of the frames left out", told[0])


def test_overdue_frame_is_left_out_without_python(bus: Any) -> None:  # noqa: F811
    host, data, arrival_ns = settled_to_be_overdue(bus)
    number = host.pipeline.messages
    assert bus.loop.take(Host.LINE, data, arrival_ns)
    assert not bus.heard()
    unread, _, left_out, _ = bus.loop.end(Host.LINE)
    assert (unread, left_out) == (b"", (1, 0, 0))
    assert host.pipeline.messages == number


class HostInTime(Host):
    overdue_ns = OVERDUE_NS


def settled_to_be_overdue(bus: Any) -> tuple[Host, bytes, int]:  # noqa: F811
    """A host that C serves from now on, and a frame's bytes with their arrival: long ago, by this computer's clock."""
    config = config_of(4)
    frames = frames_of(config, 0.2)
    reads = [(encode(hello(4)), 0)] + [(encode(sample_of(f)), f.device_time_us * 1000 + 10**9) for f in frames]
    host = HostInTime(config, simulated_baseline(config), bus, may_express=False)
    for data, arrival_ns in reads[:-1]:
        host.take(data, arrival_ns)
    host._may_express = True
    host.begin()
    assert host.lent is not None
    return host, *reads[-1]


def test_loop_is_behind_while_something_is_always_ready() -> None:
    ours, theirs = os.pipe()
    with select.epoll() as epoll:
        epoll.register(ours, select.EPOLLIN)
        loop = _pad.Loop(epoll.fileno(), 0, 0, IN_TIME, BEHIND)
        assert not loop.is_behind()
        os.write(theirs, b"x")
        for _ in range(3):
            loop.wait(0)
        assert not loop.is_behind(), "a short stall of the computer is no overload"
        for _ in range(20):
            loop.wait(0)
        assert loop.is_behind()
        os.read(ours, 1)
        loop.wait(time.monotonic_ns() + 2_000_000)
        assert not loop.is_behind()
    os.close(ours)
    os.close(theirs)


def test_few_silent_pads_are_published_at_once_and_many_in_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the frames of the others would wait for all of them."""
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    one = PadConfig(name="p0", source=SimulatedSource(finger="none"))
    pads = [msgspec.structs.replace(one, name=f"p{index}") for index in range(2 * SILENT_AT_ONCE + 1)]
    with Daemon(Config(pad=tuple(pads))) as daemon:  # noqa: F811
        channels = list(daemon._channels.values())
        told: list[str] = []
        for channel in channels:
            monkeypatch.setattr(channel.source, "poll", lambda now_ns: ())
            monkeypatch.setattr(channel, "tick", lambda now_ns, name=channel.name: told.append(name))
        for _ in range(3):
            count = len(told)
            daemon._tell_silence(time.monotonic_ns())
            assert len(told) - count <= SILENT_AT_ONCE
        assert {channel.name for channel in channels} == set(told)
