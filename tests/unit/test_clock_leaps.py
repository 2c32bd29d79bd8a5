"""A board's clock that leaps, and packets that come twice or in another order: each sample counts once, at its time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from fast_loop_host import Bus, Host, sample_of
from hypothesis import given
from hypothesis import strategies as st
from test_link import Line, hello
from test_never_fooled import CONFIG, is_wrong, taps
from test_pipeline import pipeline_of
from test_time_gate import PERIOD_NS, PERIOD_US, line_after, of

from examples import examples
from fmfts.pose.alignment import Alignment
from fmfts.runtime.statistics import PadStatistics
from fmfts.sensor import Frame
from fmfts.sensor.frame import AGE_UNKNOWN_US
from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import Early
from fmfts_simulation.baseline import simulated_baseline
from fmfts_skin.last_frame import LastFrame

RATE_HZ = 220
SOON = 66  # frames: 300 ms
AT_ONCE_NS = 1_000_000  # a packet of this line never waits
BEGUN = 300
PRESSED, RESTS = 140, 230  # frames of `taps`
TIMES = 2**48  # times on the wire: a board's 64 bits are cut to 48
# The largest is a recording's: its times have 64 bits.
POWERS = (20, 23, 33, 46, 47)


def leaping(power: int, way: int, count: int) -> list[int]:
    """The time that each packet's board tells: from BEGUN on, `count` packets are 2^power µs ahead (or back)."""
    old_us = 0 if way > 0 else 2**power
    return [
        ((number + 1) * PERIOD_US + old_us + (way * 2**power if BEGUN <= number < BEGUN + count else 0)) % TIMES
        for number in range(BEGUN + count + 2 * SOON)
    ]


@pytest.mark.parametrize("count", [1, RATE_HZ])
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("power", POWERS)
def test_line_has_right_times_soon_after_each_leap(power: int, way: int, count: int) -> None:
    line = Line()
    line.feed(hello(4))
    come = []
    for number, time_us in enumerate(leaping(power, way, count)):
        for frame in line.feed(of(number, time_us=time_us)):
            assert abs(frame.host_time_ns - line.now_ns) < AT_ONCE_NS
            come.append(frame.sequence)
    assert max(later - earlier for earlier, later in pairwise(come)) < SOON
    assert len(come) > BEGUN + count + SOON


@pytest.mark.parametrize("order", [(0, 0), (0, 0, 0), (1, 0)], ids=["doubled", "tripled", "swapped"])
def test_leap_is_followed_when_packets_come_doubled_or_swapped(order: tuple[int, ...]) -> None:
    """Copies are no evidence, and an overtaken packet contradicts nothing."""
    line = Line()
    line.feed(hello(4))
    times, size = leaping(46, 1, RATE_HZ), max(order) + 1
    come = []
    for first in range(0, len(times) - size, size):
        for number in (first + place for place in order):
            come += line.feed(of(number, time_us=times[number]), later_ns=size * PERIOD_NS // len(order))
    numbers = sorted({frame.sequence for frame in come})
    assert max(later - earlier for earlier, later in pairwise(numbers)) < SOON


@pytest.mark.parametrize("power", [20, 46])
def test_leap_is_followed_by_a_computer_that_reads_seldom(power: int) -> None:
    """Nine packets at a time, in 41 ms: the last of each read has waited least."""
    line, size = Line(), 9
    line.feed(hello(4))
    come, times = [], leaping(power, 1, RATE_HZ)
    for first in range(0, len(times) - size, size):
        packets = [of(number, time_us=times[number]) for number in range(first, first + size)]
        come += [frame.sequence for frame in line.feed(*packets, later_ns=size * PERIOD_NS)]
        line.link._clock.found_empty(line.now_ns)
    assert max(later - earlier for earlier, later in pairwise(come)) < SOON


def test_copies_of_one_packet_from_the_future_are_one() -> None:
    line = line_after(BEGUN)
    (before,) = line.feed(of(BEGUN))
    assert line.feed(*[of(BEGUN + 1, time_us=2**46)] * 3) == []
    (frame,) = line.feed(of(BEGUN + 2))
    assert frame.run == before.run


@lru_cache(maxsize=1)
def tapped() -> list[Frame]:
    return taps(2.5)


def test_frames_of_the_first_read_have_their_own_times() -> None:
    """They all arrived at once; the last one shows how long the others had waited."""
    line = Line()
    line.feed(hello(4))
    frames = line.feed(*(of(number) for number in range(4)), later_ns=0)
    steps = [later.host_time_ns - earlier.host_time_ns for earlier, later in pairwise(frames)]
    assert steps == pytest.approx([PERIOD_NS] * 3, abs=1000)
    assert frames[-1].host_time_ns == line.now_ns


def leapt(frames: list[Frame], power: int, way: int, first: int, count: int) -> list[Frame]:
    """With the times of a board whose clock leaps."""
    changed = []
    for number, frame in enumerate(frames):
        old_us, is_off = 0 if way > 0 else 2**power, first <= number < first + count
        time_us = frame.device_time_us + old_us + (way * 2**power if is_off else 0)
        changed.append(replace(frame, device_time_us=time_us))
    return changed


@pytest.mark.parametrize(
    ("power", "way", "first"),
    [(20, 1, PRESSED), (20, -1, PRESSED), (46, 1, RESTS), (52, 1, PRESSED), (52, -1, PRESSED)],
)
def test_pad_is_ok_soon_after_a_leap_of_a_second(power: int, way: int, first: int) -> None:
    """The frames of one second have wrong times. Nothing wrong is published, at the leap and after it."""
    frames = leapt(tapped()[: first + RATE_HZ + 2 * SOON], power, way, first, RATE_HZ)
    pipeline = pipeline_of(CONFIG, simulated_baseline(CONFIG))
    messages = [pipeline.process(frame) for frame in frames]
    assert not any(map(is_wrong, messages))
    assert all(message.health == "ok" for message in messages[first + SOON : first + RATE_HZ])
    assert all(message.health == "ok" for message in messages[first + RATE_HZ + SOON :])
    assert messages[-1].now is not None
    for frame, message in zip(frames, messages, strict=True):
        assert 0 <= frame.host_time_ns - message.t_sample_ns < 3 * PERIOD_NS


class TestTimePassed:
    """The size of a leap, from two frames 10 ms apart on this computer's clock."""

    def leap_us(self, there_us: int, here_ns: int = 10_000_000, numbers: int = 2) -> int:
        before, last = tapped()[-1], LastFrame(RATE_HZ)
        last.become(before.sequence, before.device_time_us, before.host_time_ns)
        after = replace(
            before,
            device_time_us=before.device_time_us + there_us,
            host_time_ns=before.host_time_ns + here_ns,
            sequence=before.sequence + numbers,
        )
        return last.leap_us(after)

    @pytest.mark.parametrize("there_us", [0, 10_000, 200_000])
    def test_gap_is_no_leap(self, there_us: int) -> None:
        assert self.leap_us(there_us) == 0

    @pytest.mark.parametrize("there_us", [2**20, 2**52, -(2**20), -(2**52)])
    def test_leap_excludes_time_that_passed_here(self, there_us: int) -> None:
        assert self.leap_us(there_us) == there_us - 10_000

    def test_stopped_clock_does_not_jump_when_it_continues(self) -> None:
        """Frames came meanwhile, with the old time."""
        last, frame = LastFrame(RATE_HZ), tapped()[-1]
        for second in range(4):
            last.become(frame.sequence + second, frame.device_time_us, frame.host_time_ns + second * 1_000_000_000)
        host_ns = frame.host_time_ns + 4_000_000_000
        assert last.leap_us(replace(frame, device_time_us=frame.device_time_us + 4_000_000, host_time_ns=host_ns)) == 0

    def test_suspended_computer_is_no_leap_of_the_board(self) -> None:
        """The host's clock stood still for an hour; the board made frames meanwhile, and numbered them."""
        assert self.leap_us(3_600_000_000, numbers=3600 * RATE_HZ) == 0

    def test_unplugged_minute_is_no_leap(self) -> None:
        assert self.leap_us(60_000_000, here_ns=60_000_000_000, numbers=1) == 0

    def test_leap_of_a_reset_is_its_age_plus_the_passed_time(self) -> None:
        assert self.leap_us(-60_000_000, here_ns=2_000_000_000, numbers=-5000) == -62_000_000


HOURS_US = 36_000_000_000  # ten
OUTAGE_US = 980_000


@pytest.mark.parametrize("silent", [1, 3])
@pytest.mark.parametrize("is_timed", [True, False], ids=["stale", "untimed"])
@pytest.mark.parametrize("age_us", [0, HOURS_US], ids=["reset", "ahead"])
def test_time_passed_is_right_when_a_leap_brings_no_sample(age_us: int, is_timed: bool, silent: int) -> None:
    """The first frames after the leap have no new sample: no age is known, or all samples are reported as old."""
    frames, alignment, last = tapped()[:20], Alignment(4, PERIOD_US), LastFrame(RATE_HZ)
    before_us, elapsed_s, behind_us = None, [], []
    for number, frame in enumerate(frames):
        is_after = number >= 10
        ahead_us = age_us if is_after else HOURS_US - age_us
        frame = replace(
            frame,
            device_time_us=frame.device_time_us + ahead_us + (OUTAGE_US if is_after else 0),
            host_time_ns=frame.host_time_ns + (OUTAGE_US * 1000 if is_after else 0),
        )
        if 10 <= number < 10 + silent:
            age = frame.age_us if is_timed else np.full_like(frame.age_us, AGE_UNKNOWN_US)
            frame = replace(frame, age_us=age, fresh=np.zeros_like(frame.fresh))
        aligned = last.aligned(frame, frame.field_t, alignment)
        elapsed_s.append(aligned.elapsed_s(before_us))
        before_us = aligned.time_us
        behind_us.append(frame.device_time_us - aligned.time_us)
    assert max(elapsed_s) < 1.1
    of_all_s = OUTAGE_US * 1e-6 + (frames[-1].device_time_us - frames[0].device_time_us) * 1e-6
    assert sum(elapsed_s) == pytest.approx(of_all_s, abs=3e-6 * PERIOD_US)
    assert min(behind_us) >= 0
    assert max(behind_us) < OUTAGE_US + (silent + 3) * PERIOD_US


def with_early(frames: list[Frame], copies: int) -> Iterator[tuple[bytes, int]]:
    """Each read, and when. Every early sample is repeated this often at once, and once more after the next frame."""
    late = b""
    for number, frame in enumerate(frames):
        sampled_us, early = frame.sampled_us.tolist(), b""
        for sensor in sorted(np.flatnonzero(frame.fresh).tolist(), key=sampled_us.__getitem__):
            x, y, z = frame.counts[sensor].tolist()
            early += encode(Early(0, sensor, frame.gain_code, sampled_us[sensor] + 1_000_000, (x, y, z))) * (1 + copies)
        frame_ns = 5_000_000_000 + 1000 * frame.device_time_us
        said = encode(hello(4, can_send_early=1)) if number == 0 else b""
        yield said + early + encode(sample_of(frame)) + late, frame_ns
        late = early if copies else b""


@pytest.mark.parametrize("in_the_loop", [True, False])
def test_early_samples_count_once_however_often_they_come(in_the_loop: bool) -> None:
    bus, published = Bus(), []
    for copies in (0, 1, 2):
        host = Host(CONFIG, simulated_baseline(CONFIG), bus, may_express=in_the_loop)
        for data, arrival_ns in with_early(tapped()[100:250], copies):
            host.take(data, arrival_ns)
        if host.lent is not None:
            host.end()
        published.append([(message.t_sample_ns, message.force_n, message.now) for message in host.told.messages])
    bus.close()
    assert len(published[0]) > 200  # 150 are frames; the others are early samples
    assert published[0] == published[1] == published[2]


@st.composite
def orders(draw: st.DrawFn) -> list[list[int]]:
    """Packets as reads bring them: each number at least once, some again, at most a few places from their own."""
    count = draw(st.integers(10, 40))
    again = draw(st.lists(st.integers(0, count - 1), max_size=30))
    places = [(number + draw(st.integers(0, 3)), number) for number in [*range(count), *again]]
    numbers = [number for _, number in sorted(places, key=lambda place: place[0])]
    bursts = draw(st.lists(st.tuples(st.integers(0, count), st.integers(1, 6)), max_size=3))
    for start, size in bursts:  # a part of the stream is repeated unchanged
        numbers[start + size : start + size] = numbers[start : start + size]
    cuts = sorted({0, len(numbers), *draw(st.lists(st.integers(0, len(numbers)), max_size=20))})
    return [numbers[start:end] for start, end in pairwise(cuts)]


@given(orders())
@examples(60)
def test_each_measurement_counts_once_in_any_order(reads: list[list[int]]) -> None:
    line, statistics = Line(), PadStatistics()
    line.feed(hello(4))
    taken: list[Frame] = []
    sent = 0
    for numbers in reads:
        frames = line.feed(*(of(number) for number in numbers), later_ns=len(numbers) * PERIOD_NS // 2)
        sent += len(frames)
        taken += [frame for frame in frames if statistics.frame(frame)]
    times = [frame.device_time_us for frame in taken]
    assert times == sorted(set(times))
    assert statistics.frames == sent == len(taken) + statistics.dropped
    assert statistics.repeated == statistics.dropped


def test_repeated_part_of_a_stream_is_counted() -> None:
    line, statistics = Line(), PadStatistics()
    line.feed(hello(4))
    numbers = [0, 1, 2, 3, 0, 1, 2, 3, 4, 5, 4, 5, 6]
    taken = [frame.sequence for frame in line.feed(*map(of, numbers)) if statistics.frame(frame)]
    assert taken == [0, 1, 2, 3, 4, 5, 6]
    assert (statistics.frames, statistics.dropped, statistics.repeated, statistics.gaps) == (13, 6, 6, 0)


def test_replay_of_a_board_that_was_reset_goes_on() -> None:
    """A recording does not mark runs: numbers and times restart, and the host's time continues."""
    statistics, frames = PadStatistics(), tapped()[:100]
    again = [replace(frame, host_time_ns=frame.host_time_ns + 1_000_000_000) for frame in frames]
    assert all(statistics.frame(frame) for frame in frames)
    assert [statistics.frame(frame) for frame in again[:4]] == [False, True, True, True]
