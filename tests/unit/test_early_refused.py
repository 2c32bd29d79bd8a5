"""Errors with samples before their frames: old frames, strange frames, samples that come late."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from fast_loop_host import LEAD, Bus, Host, sample_of
from test_early import CONFIG, answer, frames_only, on_the_wire, pipeline_with, sent_of, tapped
from test_fast_loop import bus  # noqa: F401  (a fixture)
from test_link import hello
from test_pipeline import Bench

from fmfts.bus.frame_message import early_message, early_of, frame_message, frame_of
from fmfts.bus.messages import ContactMessage, EarlyMessage
from fmfts.pipeline.configured import load_contact_model
from fmfts.runtime.lateness import OVERDUE_NS
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import fastest_on_board_hz
from fmfts.sensor.early import EarlySample
from fmfts.sensor.frame import Frame
from fmfts.sensor.wire.framing import encode
from fmfts_lab.bench.now_early import Sent
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Touch

ON_THE_LINE_NS = 900_000


def pressed_by(force_n: float) -> Callable[[float], Touch]:
    return lambda time_s: Touch(2e-3, 1e-3, force_n if time_s > 0.1 else 0.0)


def arrival_ns(packet: Sent) -> int:
    return 5 * 10**9 + packet.device_time_us * 1000 + ON_THE_LINE_NS


def test_refused_frame_gives_no_now_afterwards(bus: Bus) -> None:  # noqa: F811
    """A healthy frame of another board, pressed harder, with the next number and a clock that is 0.2 s ahead."""
    host = Host(CONFIG, simulated_baseline(CONFIG), bus)
    host.take(encode(hello(4, can_send_early=1)), 10**9)
    packets = sent_of(pressed_by(0.5), 0.5)
    mine, rest = packets[:-12], packets[-12:]
    for packet in mine:
        host.take(encode(on_the_wire(packet)), arrival_ns(packet))
    last = frames_only(mine)[-1]
    assert isinstance(last, Frame)
    theirs = next(
        frame
        for frame in frames_only(sent_of(pressed_by(1.5), 0.5))
        if isinstance(frame, Frame) and frame.sequence == last.sequence + 1
    )
    sample = sample_of(theirs)
    ahead = msgspec.structs.replace(sample, time_us=sample.time_us + 200_000)
    host.take(encode(ahead), arrival_ns(mine[-1]) + 100_000)
    for packet in rest:
        host.take(encode(on_the_wire(packet)), arrival_ns(packet))
    if host.lent is not None:
        host.end()
    assert len(host.told.messages) > 400
    told = [one.force_n for one in host.told.messages[-20:] if one.force_n is not None]
    assert told == pytest.approx([0.5] * len(told), abs=0.1)


def test_repeated_old_frame_makes_now_null_only() -> None:
    model, packets = load_contact_model(CONFIG), sent_of(tapped, 0.4)
    frames = [number for number, packet in enumerate(packets) if not isinstance(packet, EarlySample)]
    # If the filter accepted such a frame, its covariance was no longer valid.
    for frame, back, after in ((53, 3, 1), (53, 4, 1), (51, 3, 2), (51, 4, 2)):
        pipeline, at, told = pipeline_with(model), frames[frame] + after, list[ContactMessage]()
        for number, packet in enumerate(packets[: at + 30]):
            message = answer(pipeline, packet)
            if number == at:
                answer(pipeline, packets[frames[frame - back]])
            elif number > at and message is not None:
                told.append(message)
        numbers = [[*msgspec.structs.asdict(one.now).values()] for one in told if one.now is not None]
        assert np.isfinite([one for each in numbers for one in each if one is not None]).all()
        assert told[-1].now is not None


def channel_in_touch(bench: Bench) -> EarlySample:
    """Brings a channel to where samples before frames are used. Returns the next of them, taken now."""
    packets = sent_of(tapped, 0.3)
    for packet in packets[:-8]:
        if isinstance(packet, Frame):
            frame = frame_of(frame_message(packet, CONFIG.name, "boot", 0), chip=packet.chip)
            bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns()))
        else:
            bench.pipeline.early(packet)
    return next(packet for packet in packets[-8:] if isinstance(packet, EarlySample))


@pytest.mark.parametrize("late", [False, True])
def test_sample_that_is_late_is_not_published(late: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    with Bench(CONFIG, lead=LEAD) as bench:
        bench.pipeline.use(simulated_baseline(CONFIG))
        early = channel_in_touch(bench)
        age_ns = OVERDUE_NS + 1_000_000 if late else 1_000_000
        monkeypatch.setattr(bench.pipeline, "host_time_ns", lambda device_us: time.monotonic_ns() - age_ns)
        sent = len(bench.sent)
        bench.channel.early(early)
        assert len(bench.sent) == sent + (not late)


def test_recorders_get_no_sample_before_state_that_answers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a new baseline the state goes out with the next frame; a replay still has the old one until then."""
    with Bench(CONFIG, lead=LEAD) as bench:
        bench.pipeline.use(simulated_baseline(CONFIG))
        early, recorded, waits = channel_in_touch(bench), list[EarlyMessage](), True
        monkeypatch.setattr(bench.pipeline, "host_time_ns", lambda device_us: time.monotonic_ns())
        monkeypatch.setattr(bench._publisher, "frames_wanted", lambda pad, now_ns: True)
        monkeypatch.setattr(bench._publisher, "state_wanted", lambda pad: waits)
        monkeypatch.setattr(bench._publisher, "send_early", lambda pad, message: recorded.append(message))
        sent = len(bench.sent)
        bench.channel.early(early)
        assert (len(recorded), len(bench.sent) - sent) == (0, 0)
        waits = False
        bench.channel.early(early)
        assert (len(recorded), len(bench.sent) - sent) == (1, 1)


@pytest.mark.parametrize(
    "damage", [{"sensor": -1}, {"gain_code": 9}, {"device_time_us": -1}, {"counts": (40_000, 0, 0)}]
)
def test_recorded_sample_that_no_chip_gives_is_refused(damage: dict[str, object]) -> None:
    whole = early_message(EarlySample(0, 1, 5, 2, (1, 2, 3)), "left", "boot", 0)
    assert early_of(whole).counts == (1, 2, 3)
    with pytest.raises(ValueError, match="no chip gives"):
        early_of(msgspec.structs.replace(whole, **damage))


@pytest.mark.parametrize(
    ("kind", "rate_hz", "samples_hz"),
    [("hmc5983", 30, 226.6), ("mmc5983ma", 200, 399.0), ("mlx90393", 100, 139.65), ("qmc5883l", 200, 210.0)],
)
def test_chip_gives_samples_at_rate_that_board_runs_it_at(kind: str, rate_hz: int, samples_hz: float) -> None:
    """It differs from the frames' rate: the HMC5983 has one rate on a board, and an MMC5983MA is restarted at once."""
    assert fastest_on_board_hz(CHIPS[kind], rate_hz) == pytest.approx(samples_hz)
