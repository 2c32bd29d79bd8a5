"""Packets that are valid, and whose time cannot be: from the future, from the past, or there before."""

from __future__ import annotations

import random
from typing import Any

import pytest
from test_link import Line, hello, sample

from fmfts.runtime.statistics import PadStatistics
from fmfts.sensor.numbering import MOST_MISSING

PERIOD_US = 4545
PERIOD_NS = 1000 * PERIOD_US


def line_after(frames: int) -> Line:
    """A line whose board has sent so many frames, its hello first."""
    line = Line()
    line.feed(hello(4))
    for number in range(frames):
        assert len(line.feed(of(number))) == 1
    return line


def of(number: int, **changes: int) -> Any:
    return sample(**({"sequence": number, "time_us": (number + 1) * PERIOD_US} | changes))


@pytest.mark.parametrize("power", [25, 40, 45, 46, 47])
def test_one_packet_from_the_future_changes_nothing(power: int) -> None:
    line = line_after(300)
    (before,) = line.feed(of(300))
    assert line.feed(of(301, time_us=2**power)) == []
    (frame,) = line.feed(of(302))
    assert frame.run == before.run
    assert frame.host_time_ns - before.host_time_ns == pytest.approx(2 * PERIOD_NS, abs=PERIOD_NS / 2)
    assert "packets" in line.state.warnings


@pytest.mark.parametrize("back", [10, 220, 2000])
def test_packets_that_come_again_are_not_taken_for_new_ones(back: int) -> None:
    """One between two others, and a burst of them at once."""
    line = line_after(2100)
    assert line.feed(of(2100 - back), later_ns=1_000_000) == []
    (before,) = line.feed(of(2100), later_ns=PERIOD_NS - 1_000_000)
    again = [of(number) for number in range(2100 - back, min(2100 - back + 40, 2095))]
    assert line.feed(*again, later_ns=0) == []
    (frame,) = line.feed(of(2101))
    assert frame.run == before.run
    assert frame.host_time_ns - before.host_time_ns == pytest.approx(PERIOD_NS, abs=PERIOD_NS / 2)


@pytest.mark.parametrize("seed", range(30))
def test_a_second_of_old_packets_is_not_accepted(seed: int) -> None:
    """New packets come damaged, and now and then some of a second ago come again: as from a clock a second late."""
    line, dice = line_after(2100), random.Random(seed)
    line.feed(later_ns=0)
    frames = []
    for number in range(2100, 2320):
        # Frames of the last 20 ms keep their own time, which is a second old by then.
        burst = range(number - 220, min(number - 220 + dice.randrange(1, 12), 2095))
        again = [of(old) for old in burst] if dice.random() < 0.1 else []
        frames += line.feed(*again, later_ns=PERIOD_NS)
    assert frames == []


def test_board_that_was_reset_is_accepted_with_its_hello_at_once() -> None:
    line = line_after(300)
    line.feed(hello(4))
    frames = [frame for number in range(4) for frame in line.feed(of(number))]
    assert len(frames) == 4
    assert len({frame.run for frame in frames}) == 1
    assert [frame.sequence for frame in frames] == [0, 1, 2, 3]


def test_board_that_was_reset_is_accepted_without_its_hello_after_some_packets() -> None:
    """Its hello was lost: three packets convince."""
    line = line_after(2300)
    frames = [frame for number in range(20) for frame in line.feed(of(number))]
    assert len(frames) == 18
    # The board was young: the frames might be repeated old ones, even the first. After a tenth of a second the new
    # clock is accepted.
    for first in (0, 20):
        young = line_after(300)
        frames = [frame for number in range(first, 150) for frame in young.feed(of(number))]
        assert len(frames) == pytest.approx(128 - first, abs=3)


@pytest.mark.parametrize("first", [0, 100])
def test_old_packets_are_not_accepted_after_hello_that_was_asked_for(first: int) -> None:
    """A strange packet makes the daemon ask; the answer may come between two bursts of old packets."""
    line = line_after(300)
    (before,) = line.feed(of(300))
    for number in range(301, 340):
        again = [of(old) for old in range(first, first + 8)]
        assert line.feed(*again, later_ns=0) == []
        line.feed(hello(4), later_ns=0)
        assert line.feed(*again, later_ns=0) == []
        (frame,) = line.feed(of(number))
        assert frame.run == before.run


def test_old_hello_admits_no_old_packet() -> None:
    """The fast loop reads the packets after it, which the gate never sees."""
    line = line_after(300)
    line.feed(hello(4))
    clock = line.link._clock
    for number in range(300, 340):
        clock.to_host_ns((number + 1) * PERIOD_US, line.now_ns + (number - 299) * PERIOD_NS)
    assert line.feed(of(100), later_ns=41 * PERIOD_NS) == []


@pytest.mark.parametrize("with_hello", [True, False])
def test_clock_does_not_begin_with_a_packet_that_waited_here(with_hello: bool) -> None:
    """The board is reset while this host does not read for 0.4 s; what it read first is as old as that."""
    line = line_after(300)
    line.link._clock.found_empty(line.now_ns)
    backlog = [of(number) for number in range(3)]
    assert line.feed(*([hello(4)] if with_hello else []), *backlog, later_ns=400_000_000) == []
    for number in range(88, 120):
        line.link._clock.found_empty(line.now_ns)
        for frame in line.feed(of(number)):
            assert frame.host_time_ns == line.now_ns
    assert frame.sequence == 119


def test_clock_does_not_begin_with_packets_that_are_sent_again() -> None:
    """A port was opened, and this host reads seldom. With each new packet some of a second ago come, as from a clock
    that is a second late: they agree with each other from read to read."""
    line, frames = line_after(1), []
    line.link.restart()
    for number in range(300, 420, 10):
        line.link._clock.found_empty(line.now_ns)
        packets = [hello(4)] if number == 300 else [of(number), *(of(old) for old in range(number - 220, number - 212))]
        frames += line.feed(*packets, later_ns=10 * PERIOD_NS)
    assert [frame.sequence for frame in frames] == list(range(320, 420, 10))


def test_slow_boards_clock_is_accepted_with_the_second_packet() -> None:
    """At 10 Hz every packet may have waited since the one before was read."""
    line = line_after(300)
    frames = []
    for number in range(4):
        line.link._clock.found_empty(line.now_ns)
        packets = [hello(4)] if number == 0 else []
        frames += line.feed(*packets, of(number, time_us=1000 + 100_000 * number), later_ns=100_000_000)
    assert [frame.sequence for frame in frames] == [1, 2, 3]
    assert "packets" not in line.state.warnings


def test_computer_that_was_suspended_goes_on() -> None:
    """Its clock stood for an hour, the board's did not."""
    line = line_after(300)
    later = [of(number) for number in range(792_300, 792_320)]
    frames = [frame for packet in later for frame in line.feed(packet)]
    assert len(frames) == 18


class TestSequence:
    def count(self, *numbers: int) -> tuple[PadStatistics, list[bool]]:
        line, statistics = Line(), PadStatistics()
        line.feed(hello(4))
        taken = []
        for at, number in enumerate(numbers):
            (frame,) = line.feed(sample(sequence=number % 2**32, time_us=(at + 1) * PERIOD_US))
            taken.append(statistics.frame(frame))
        return statistics, taken

    def test_packet_that_came_twice_is_dropped_and_counted(self) -> None:
        statistics, taken = self.count(5, 6, 6, 7, 7, 8, 5, 9)
        assert taken == [True, True, False, True, False, True, False, True]
        assert (statistics.frames, statistics.dropped, statistics.gaps) == (8, 3, 0)

    def test_impossible_number_is_dropped_and_later_ones_are_used(self) -> None:
        statistics, taken = self.count(5, 2**31, 6, 7)
        assert taken == [True, False, True, True]
        assert statistics.gaps == 0

    def test_consecutive_numbers_are_accepted(self) -> None:
        """Whatever made them jump, the pad does not stay dropped."""
        _, taken = self.count(5, 5 + 2 * MOST_MISSING, 6 + 2 * MOST_MISSING, 7 + 2 * MOST_MISSING)
        assert taken == [True, False, True, True]

    def test_sequence_continues_after_a_wraparound(self) -> None:
        statistics, taken = self.count(2**32 - 2, 2**32 - 1, 0, 1, 3)
        assert all(taken)
        assert statistics.gaps == 1
