"""The guard before a source: what it does with errors, with too many frames and slow polls, and how soon it tries."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from faulty_source import ERRORS
from fmfts.config import PadConfig, SimulatedSource
from fmfts.runtime import budget, guarded
from fmfts.runtime.failure import sentence_of, text_of, trace_of
from fmfts.runtime.guarded import GuardedSource
from fmfts.sensor import Frame, Source, SourceError, SourceState
from fmfts.sensor.patience import IN_TIME, RECORDED, Patience
from fmfts.sensor.source import CannotError
from fmfts_simulation.source import Simulated

(FRAME,) = Simulated(PadConfig(name="left", source=SimulatedSource())).poll(10**9)


@dataclass(eq=False)
class Scripted:
    """A Source whose polls and self-tests do what they are given."""

    polled: Callable[[], Any] = lambda: ()
    tested: Callable[[], Any] = lambda: None
    state: SourceState = field(default_factory=lambda: SourceState("scripted"))

    def fileno(self) -> None:
        return None

    def deadline_ns(self) -> int:
        return 0

    def poll(self, now_ns: int) -> Sequence[Frame]:
        self.state.connect(now_ns)
        frames: Sequence[Frame] = self.polled()
        return frames

    def request_selftest(self, pad_index: int) -> None:
        self.tested()

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        self.tested()
        return None

    def close(self) -> None:
        self.state.disconnect("closed", 1)


@dataclass
class Paused:
    """A Renewal that takes no time, and keeps the pauses that it was asked for."""

    pauses: list[float] = field(default_factory=list)
    is_over = True

    def __call__(self, failed: Source | None, pause_s: float, open_device: Callable[[], Source]) -> Paused:
        self.pauses.append(pause_s)
        self.result = open_device
        return self


@pytest.fixture
def paused(monkeypatch: pytest.MonkeyPatch) -> Paused:
    paused = Paused()
    monkeypatch.setattr(guarded, "Renewal", paused)
    return paused


def opened(**scripted: Callable[[], Any]) -> GuardedSource:
    source = GuardedSource(lambda: Scripted(**scripted), (0,), "scripted")
    source.open()
    return source


def test_pauses_grow_while_a_source_fails_soon(paused: Paused) -> None:
    source = opened(polled=ERRORS["ValueError"])
    for _ in range(20):
        source.poll(1)
    assert paused.pauses[:8] == [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0]
    assert source.state.reconnects == len(paused.pauses) - 1


def test_failure_is_the_reason_until_the_next_source_works(paused: Paused) -> None:
    scripts = iter([ERRORS["OSError"], lambda: ()])
    source = GuardedSource(lambda: Scripted(next(scripts)), (0,), "scripted")
    source.open()
    source.poll(1)
    assert source.changed
    assert source.device is None
    assert "internal error in poll: OSError: [Errno 5]" in source.state.reason
    source.poll(2)
    assert source.changed
    assert not source.state.connected
    assert "OSError" in source.state.reason
    source.poll(3)
    assert not source.changed
    assert (source.state.connected, source.state.reason) == (True, "")


@pytest.mark.parametrize(
    ("patience", "most"),
    [(IN_TIME, budget.MOST_JUDGED), (RECORDED, budget.MOST_RECORDED)],
    ids=["judged", "recorded"],
)
def test_oldest_of_too_many_frames_are_left_out(patience: Patience, most: int) -> None:
    source = opened(polled=lambda: [replace(FRAME, sequence=number) for number in range(most + 7)])
    source.patience = patience
    assert [frame.sequence for frame in source.poll(1)] == list(range(7, most + 7))
    assert source.state.left_out == {0: 7}


@pytest.mark.parametrize("each_poll", [1, 4, 2_000])
def test_flood_is_handled_at_twice_its_nominal_rate_at_most(each_poll: int) -> None:
    source = GuardedSource(lambda: Scripted(lambda: [FRAME] * each_poll), (0,), "scripted", rate_hz=200.0)
    source.open()
    source.patience = IN_TIME
    handled = [len(source.poll(10**9 + ms * 1_000_000)) for ms in range(4_000)]
    assert sum(handled[1_000:]) == pytest.approx(2 * 200 * 3, abs=1)
    assert sum(handled) + source.state.left_out[0] == each_poll * 4_000
    assert "rate_hz" in source.state.warnings["flood"]


def test_backlog_of_a_stall_is_no_flood() -> None:
    backlogs = iter([20, *[1] * 100, 20])
    source = GuardedSource(lambda: Scripted(lambda: [FRAME] * next(backlogs)), (0,), "scripted", rate_hz=200.0)
    source.open()
    source.patience = IN_TIME
    assert sum(len(source.poll(10**9 + number * 5_000_000)) for number in range(102)) == 140
    assert not source.state.warnings


def test_long_text_of_a_source_is_shortened(paused: Paused) -> None:
    def fail() -> None:
        raise SourceError("x" * (1 << 21))

    source = opened(polled=fail)
    source.poll(1)
    assert len(source.state.reason) < 1_000


@dataclass(eq=False)
class Counting(Scripted):
    """It cannot be used, and counts in `closed` how often it was closed."""

    state: Any = None
    closed: list[int] = field(default_factory=list)

    def close(self) -> None:
        self.closed.append(1)


def test_device_that_cannot_be_used_is_closed() -> None:
    devices = [Counting(), Counting()]
    opening = iter([*devices, Scripted()])
    source = GuardedSource(lambda: next(opening), (0,), "scripted")
    source.open()
    end_s = time.monotonic() + 60.0
    while not source.state.connected:
        source.poll(time.monotonic_ns())
        assert time.monotonic() < end_s
    assert [len(device.closed) for device in devices] == [1, 1]


def test_source_is_given_up_after_three_slow_polls(paused: Paused, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "SLOW_S", -1.0)
    source = opened()
    source.poll(1)
    source.poll(2)
    assert source.state.connected
    source.poll(3)
    assert "all other pads wait meanwhile" in source.state.reason


@pytest.mark.parametrize("ask", ["request_selftest", "selftest_result"])
def test_selftest_that_fails_is_refused_with_its_reason(ask: str) -> None:
    with pytest.raises(CannotError, match=f"internal error in {ask}: SystemExit: 3"):
        getattr(opened(tested=ERRORS["SystemExit"]), ask)(0)
    with pytest.raises(SourceError, match="on fire"):
        getattr(opened(tested=ERRORS["SourceError"]), ask)(0)


def test_source_whose_deadline_is_always_now_waits_a_little() -> None:
    source = opened()
    source.poll(1)
    due_ns = source.deadline_ns()
    assert due_ns is not None
    assert due_ns > time.monotonic_ns() - 10**9


def test_source_that_computes_for_long_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    source, computed_ns = opened(), iter([0, 20_000_000])
    monkeypatch.setattr("time.thread_time_ns", lambda: next(computed_ns))
    begun_ns = time.monotonic_ns()
    source.poll(1)
    due_ns = source.deadline_ns()
    assert due_ns is not None
    assert due_ns >= begun_ns + 180_000_000


def test_ctrl_c_passes_through_the_guard() -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        opened(polled=interrupted).poll(1)


@pytest.mark.parametrize("kind", ERRORS)
def test_text_of_any_error_fits_a_message(kind: str) -> None:
    with pytest.raises(BaseException) as raised:  # noqa: PT011 - any
        ERRORS[kind]()
    assert len(sentence_of(raised.value).encode()) < 1000
    assert "\n" not in text_of(raised.value)
    assert len(trace_of(raised.value).encode().splitlines()) < 60
