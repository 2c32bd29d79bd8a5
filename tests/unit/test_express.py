"""A frame from its bytes to its message in one call, against the same by way of frames: equal to the last bit."""

from __future__ import annotations

import select
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import msgspec
import numpy as np
import pytest
from test_bridge import PATIENCE_S, board, connected, pad, run  # noqa: F401  (a fixture)
from test_healthy_path import frames_of, with_faults
from test_link import hello
from test_pipeline import config_of, pipeline_of

from emulator.board import Board
from fmfts.ambient import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.config import BridgeSource, PadConfig
from fmfts.contact_message import PackedMessage
from fmfts.healthy.compiled import AVAILABLE
from fmfts.jobs.simulated_baseline import simulated_baseline
from fmfts.running.channel import OVERDUE_S
from fmfts.sensor import Frame
from fmfts.sensor.bridge import Bridge
from fmfts.sensor.clock import STANDSTILL_NS, DeviceClock
from fmfts.sensor.framing import encode
from fmfts.sensor.link import Link
from fmfts.sensor.packets import TEMPERATURE_UNKNOWN, Sample
from fmfts.sensor.source import SourceState

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="the healthy path was not compiled")

Read = tuple[bytes, int]


def sample_of(frame: Frame) -> Sample:
    _, valid, fresh, _ = frame.packed
    return Sample(
        pad_index=0,
        sequence=frame.sequence,
        time_us=frame.device_time_us + 1_000_000,
        gain_code=frame.gain_code,
        trigger=0,
        valid=valid,
        fresh=fresh,
        temperature_raw=TEMPERATURE_UNKNOWN if frame.temperature_c is None else round((frame.temperature_c - 25) * 128),
        counts=frame.counts,
        age_us=frame.age_us,
    )


def reads_of(frames: Iterable[Frame], seed: int) -> Iterator[Read]:
    """What a busy host reads of a line that loses bytes, and when. The board's clock is 50 ppm off; it stands once."""
    draw = np.random.default_rng(seed)
    pending, readable_ns = encode(hello(4)), 0
    for number, frame in enumerate(frames):
        line = encode(sample_of(frame))
        accident = draw.integers(60)
        if accident == 0:
            line = line[:20] + line[25:]
        elif accident == 1:
            line = bytes(draw.integers(0, 256, 9, dtype=np.uint8)) + line
        elif accident == 2:
            line += encode(hello(4))
        pending += line
        sent_ns = 5_000_000_000 + round(frame.device_time_us * 1000 * (1 + 50e-6))
        if number > 900:
            sent_ns += 100_000_000
        readable_ns = max(readable_ns, sent_ns) + round(draw.exponential(80e3))
        if number % 97 == 50:
            readable_ns += 30_000_000 if number < 700 else 450_000_000
        # Several lines in one read, or the beginning of one.
        if accident == 3:
            yield pending[:-13], readable_ns
            pending = pending[-13:]
        elif accident > 8:
            yield pending, readable_ns
            pending = b""


@dataclass
class Told:
    messages: list[ContactMessage]
    expressed: int


def link_of(config: PadConfig) -> tuple[Link, DeviceClock]:
    on_bridge = msgspec.structs.replace(config, source=BridgeSource(port="/dev/null"))
    link = Link({0: on_bridge}, SourceState("a board"), clock := DeviceClock())
    link.restart()
    return link, clock


def told(config: PadConfig, baseline: Baseline, reads: Iterable[Read], may_express: bool) -> Told:
    link, clock = link_of(config)
    pipeline, result = pipeline_of(config, baseline), Told([], 0)
    for data, arrival_ns in reads:
        end = 0
        while may_express and link.welcomes(0) and (found := pipeline.express(clock.line, 0, data, end, arrival_ns)):
            end, payload, _, sampled_ns, _ = found
            result.expressed += 1
            result.messages.append(msgspec.msgpack.decode(payload, type=ContactMessage))
            assert result.messages[-1].t_sample_ns == sampled_ns
        for frame in link.feed(data[end:], arrival_ns) if data[end:] else ():
            answer = pipeline.answer(frame)
            result.messages.append(answer.message if isinstance(answer, PackedMessage) else answer)
    return result


def at_no_time(messages: list[ContactMessage]) -> list[ContactMessage]:
    return [msgspec.structs.replace(message, t_publish_ns=0, utc_ns=0) for message in messages]


@pytest.mark.parametrize("faulty", [False, True], ids=["healthy", "with faults"])
def test_a_session_says_the_same_by_express(faulty: bool) -> None:
    config = config_of(4)
    baseline, frames = simulated_baseline(config), frames_of(config, 14 * 110 / 220)
    reads = list(reads_of(with_faults(frames) if faulty else frames, seed=5))
    by_express, by_frames = (told(config, baseline, reads, may_express) for may_express in (True, False))
    assert at_no_time(by_express.messages) == at_no_time(by_frames.messages)
    assert by_frames.expressed == 0
    assert by_express.expressed > (0.3 if faulty else 0.7) * len(by_frames.messages)


def test_a_frame_that_is_not_ordinary_changes_nothing() -> None:
    config = config_of(4)
    frames = frames_of(config, 1.0)
    reads = [(encode(hello(4)), 0)] + [(encode(sample_of(f)), f.device_time_us * 1000 + 10**9) for f in frames]
    link, clock = link_of(config)
    pipeline = pipeline_of(config, simulated_baseline(config))
    for data, arrival_ns in reads[:-1]:
        for frame in link.feed(data, arrival_ns):
            pipeline.answer(frame)
    data, arrival_ns = reads[-1]
    arrival_ns += 100_000
    saturated = frames[-1].counts.copy()
    saturated[2, 1] = -4096
    unusable = [
        encode(sample_of(replace(frames[-1], counts=saturated))),
        encode(sample_of(replace(frames[-1], temperature_c=None))),
        data[:-1],
        data[:10] + data[11:],
        b"",
    ]
    line = bytes(clock.line)
    for other in unusable:
        assert pipeline.express(clock.line, 0, other, 0, arrival_ns) is None
    assert pipeline.express(clock.line, 1, data, 0, arrival_ns) is None  # another pad of the board
    assert pipeline.express(clock.line, 0, data, 0, arrival_ns + 450_000_000) is None  # is its clock right?
    assert pipeline.express(clock.line, 0, data, 0, arrival_ns - 10_000_000) is None  # early: so must it
    assert bytes(clock.line) == line
    number = pipeline.messages
    found = pipeline.express(clock.line, 0, data, 0, arrival_ns)
    assert found is not None
    assert found[0] == len(data)
    assert pipeline.messages == number + 1


def test_bytes_go_past_the_frames_only_while_all_is_well(board: Board) -> None:  # noqa: F811
    """To whoever asked for them; what he leaves, and all that is not a sample, becomes frames and facts as ever."""
    bridge, taken, left = Bridge({0: pad(board.link)}), [], b""

    def take(data: bytes, now_ns: int) -> bytes:
        taken.append(data)
        return left

    bridge.express_to(0, take)
    connected(bridge, board)
    assert not bridge.express(time.monotonic_ns())  # no frame yet: nothing is known to be well
    board.send(board.sample())
    assert len(run(bridge, board, until=lambda: frames, frames=(frames := []))) == 1
    board.send(board.sample())
    wait_for(bridge)
    heard_ns = bridge._link.heard_ns
    assert bridge.express(time.monotonic_ns())
    assert len(taken) == 1
    assert bridge._link.heard_ns > heard_ns
    left = taken[0]
    board.send(board.sample())
    wait_for(bridge)
    assert not bridge.express(now_ns := time.monotonic_ns())
    assert len(bridge.poll(now_ns)) == 1
    bridge.request_selftest(0)
    board.send(board.sample())
    wait_for(bridge)
    assert not bridge.express(time.monotonic_ns())  # something is asked: whoever knows about it reads
    assert len(taken) == 2


def wait_for(bridge: Bridge) -> None:
    assert select.select([bridge.fileno()], [], [], PATIENCE_S)[0]


def test_no_frame_goes_by_express_that_is_too_old_to_be_used() -> None:
    assert STANDSTILL_NS * 1e-9 < OVERDUE_S
