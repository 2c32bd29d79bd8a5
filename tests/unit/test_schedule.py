"""Who is polled when: sources with bytes, and sources whose time has come; never one that sleeps."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest

from fmfts.bus.publisher import Publisher
from fmfts.runtime import fast_loop
from fmfts.runtime.fast_loop import FastLoop
from fmfts.runtime.schedule import Schedule
from fmfts.sensor import Source
from fmfts_client import Endpoints

FAR_NS = 60_000_000_000


class Piped:
    """The part of a Source that the schedule waits for."""

    def __init__(self) -> None:
        self.deadline: int | None = None
        self.asked = 0
        self.open()

    def open(self) -> None:
        self.ours, self.theirs = os.pipe()
        self.reading: int | None = self.ours

    def close(self) -> None:
        os.close(self.ours)
        os.close(self.theirs)
        self.reading = None

    def fileno(self) -> int | None:
        return self.reading

    def deadline_ns(self) -> int | None:
        self.asked += 1
        return self.deadline


@pytest.fixture(params=[True, False], ids=["in C", "in Python"])
def two(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Schedule, Piped, Piped]]:
    if not request.param:
        monkeypatch.setattr(fast_loop, "send_function", lambda: None)
    sources, publisher = (Piped(), Piped()), Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), "boot")
    waiting = FastLoop(publisher)
    schedule = Schedule(cast(list[Source], list(sources)), waiting)
    schedule.wait(0)  # the first wait considers every deadline
    for source in sources:
        schedule.served(cast(Source, source))
    yield schedule, *sources
    waiting.close()
    publisher.close()
    for source in sources:
        if source.reading is not None:
            source.close()


def soon() -> int:
    return time.monotonic_ns() + 20_000_000


def test_source_with_bytes_is_polled_and_sleeping_ones_cost_nothing(two: tuple[Schedule, Piped, Piped]) -> None:
    schedule, awake, asleep = two
    os.write(awake.theirs, b"x")
    asked = asleep.asked
    assert schedule.wait(soon()) is awake
    assert asleep.asked == asked


def test_due_source_is_polled(two: tuple[Schedule, Piped, Piped]) -> None:
    schedule, due, _ = two
    due.deadline = time.monotonic_ns() + 1_000_000
    schedule.review()
    until = time.monotonic_ns() + FAR_NS
    assert schedule.wait(until) is due
    assert time.monotonic_ns() < until


def test_earlier_deadline_set_during_a_poll_is_kept(two: tuple[Schedule, Piped, Piped]) -> None:
    schedule, due, _ = two
    due.deadline = time.monotonic_ns() + 1_000_000
    schedule.served(cast(Source, due))
    assert schedule.wait(time.monotonic_ns() + FAR_NS) is due


def test_postponed_deadline_causes_no_wake_up(two: tuple[Schedule, Piped, Piped]) -> None:
    schedule, source, _ = two
    source.deadline = time.monotonic_ns()
    schedule.review()
    source.deadline = time.monotonic_ns() + FAR_NS
    assert schedule.wait(soon()) is None


def test_reopened_source_is_heard_on_its_new_descriptor(two: tuple[Schedule, Piped, Piped]) -> None:
    """Whatever number it gets: a closed one has left epoll by itself, and may be another source's by now."""
    schedule, gone, other = two
    gone.close()
    schedule.served(cast(Source, gone))
    other.close()
    schedule.served(cast(Source, other))
    other.open()
    schedule.served(cast(Source, other))
    gone.open()
    schedule.served(cast(Source, gone))
    os.write(gone.theirs, b"x")
    assert schedule.wait(soon()) is gone
    os.write(other.theirs, b"x")
    assert {id(schedule.wait(soon())) for _ in range(2)} == {id(gone), id(other)}


def test_sources_that_are_due_together_are_not_all_asked_in_each_turn(two: tuple[Schedule, Piped, Piped]) -> None:
    """64 silent boards are due all the time: to ask each before each poll would take half of a core."""
    schedule, *sources = two
    for source in sources:
        source.deadline = time.monotonic_ns()
    schedule.review()
    asked = [source.asked for source in sources]
    polled = schedule.wait(soon())
    assert polled in sources
    assert [source.asked - before for source, before in zip(sources, asked, strict=True)] == [
        int(source is polled) for source in sources
    ]
    assert {id(polled), id(schedule.wait(soon()))} == {id(source) for source in sources}


def test_own_descriptor_is_noticed_beside_a_busy_source(two: tuple[Schedule, Piped, Piped]) -> None:
    schedule, awake, _ = two
    ours, theirs = os.pipe()
    try:
        schedule.wake_for(ours)
        os.write(awake.theirs, b"x")
        schedule.wait(soon())
        assert not schedule.called
        os.write(theirs, b"x")
        schedule.wait(soon())
        assert schedule.called
    finally:
        os.close(ours)
        os.close(theirs)


def test_source_with_frames_is_not_asked_for_its_deadline(two: tuple[Schedule, Piped, Piped]) -> None:
    schedule, source, _ = two
    asked = source.asked
    schedule.served(cast(Source, source), had_frames=True)
    assert source.asked == asked
    schedule.served(cast(Source, source))
    assert source.asked == asked + 1


def test_sources_take_turns_however_long_one_has_bytes(two: tuple[Schedule, Piped, Piped]) -> None:
    """One is polled in each turn, so that what C handles goes on between two frames that Python judges."""
    schedule, one, other = two
    for source in two[1:]:
        os.write(source.theirs, b"x")
    assert [schedule.wait(soon()) for _ in range(4)] in ([one, other] * 2, [other, one] * 2)
