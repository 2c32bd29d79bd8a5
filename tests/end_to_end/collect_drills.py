"""`make collect-drills`: the real process by the real clock; how soon the rod is off the pad after each fault.

The emulated devices must not be late, so nothing else may run meanwhile. Each drill reports how late the bench itself
was.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from end_to_end.collecting_bench import PressedBench
from end_to_end.test_collect import plan, rows
from end_to_end.test_collect_faults import ONE_PLACE
from fmfts_collect.guard import HANG_S

STOPPED = 69
LIFTED_WITHIN_S = 0.15  # the limit for an unplugged gauge: reading and deciding takes 20 ms, 1 mm at 20 mm/s 50 ms
PATIENCE_S = 30.0
TRIES = 5
LATE_S = 0.02  # a device that stood still for this long counts as absent


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    with PressedBench(folder, real_time=True) as bench:
        done = bench.command("baseline", "--rest", "--duration-s", "1")
        assert done.returncode == 0, done.stderr
    return folder / "state"


Benches = Iterator[PressedBench]


@pytest.fixture(params=["marlin", "grbl"])
def benches(request: pytest.FixtureRequest, tmp_path: Path, recorded: Path) -> Iterator[Benches]:
    """A fresh bench for each attempt; the previous one is closed."""

    def one_after_the_other() -> Benches:
        for number in range(TRIES):
            folder = tmp_path / str(number)
            shutil.copytree(recorded, folder / "state")
            quick = {"lift_mm_per_s": 20.0, "z_limit_mm_per_s": 20.0}  # the time for which LIFTED_WITHIN_S was set
            with PressedBench(folder, request.param, speed=1.0, real_time=True, **quick) as bench:
                yield bench

    made = one_after_the_other()
    yield made
    made.close()


def lifted(
    benches: Benches, fault: Callable[[PressedBench, subprocess.Popen[str]], object], within_s: float = LIFTED_WITHIN_S
) -> tuple[int, str]:
    """Exit code and reason of the process; prints the times. A result from a late bench does not count."""
    for bench in benches:
        process = bench.start("collect", plan(bench.folder, ONE_PLACE), "-o", bench.folder / "data.csv")
        bench.when_pressing(lambda bench=bench, process=process: fault(bench, process))
        _, errors = process.communicate(timeout=PATIENCE_S)
        took_s, late_s = bench.lifted_after_s, bench.latest_s
        took = "not at all" if took_s is None else f"after {took_s * 1e3:.0f} ms"
        print(f"\nthe rod was off the pad {took}; the bench was late by at most {late_s * 1e3:.0f} ms")
        if took_s is not None and took_s < within_s:
            return process.returncode, errors
        # A session that ended before the fault ended because something was late, perhaps the board's own process.
        assert not bench.fault_happened or late_s > LATE_S, errors
    pytest.fail("the bench was late each time: is anything else running?")


def test_gauge_unplugged(benches: Benches) -> None:
    code, reason = lifted(benches, lambda bench, _: bench.gauge.unplug())
    assert code == STOPPED
    assert "plug it in again; the rod was lifted by" in reason


def test_gauge_silent(benches: Benches) -> None:
    code, reason = lifted(
        benches, lambda bench, _: setattr(bench.gauge, "silent", True), within_s=0.1 + LIFTED_WITHIN_S
    )
    assert code == STOPPED
    assert "the gauge is silent for 1" in reason


def test_frame_lost(benches: Benches) -> None:
    code, reason = lifted(benches, lambda bench, _: bench.tell("truncate"))
    assert code == STOPPED
    assert "frames were lost" in reason


def test_over_force_lifts_the_rod(benches: Benches) -> None:
    code, reason = lifted(benches, lambda bench, _: setattr(bench, "stiffening", 20.0))
    assert code == STOPPED
    assert "over-force" in reason


def test_collector_killed(benches: Benches) -> None:
    """The guard first waits until the machine has halted."""
    code, said = lifted(benches, lambda _, process: process.kill(), within_s=1.0)
    assert code == -signal.SIGKILL
    assert "the rod was sent up" in said


def test_collector_hangs(benches: Benches) -> None:
    """It is stopped for three seconds; when it continues, it ends."""

    def stop(_: PressedBench, process: subprocess.Popen[str]) -> None:
        process.send_signal(signal.SIGSTOP)
        threading.Timer(3.0, process.send_signal, [signal.SIGCONT]).start()

    code, said = lifted(benches, stop, within_s=1.0 + HANG_S)
    assert code == STOPPED
    assert "its guard sent the rod up" in said


def test_collector_told_to_end(benches: Benches) -> None:
    code, reason = lifted(benches, lambda _, process: process.terminate())
    assert code == STOPPED
    assert "interrupted; the rod was lifted by" in reason


def test_plan_is_collected(benches: Benches) -> None:
    for bench in benches:
        done = bench.command("collect", plan(bench.folder), "-o", bench.folder / "data.csv")
        if done.returncode == 0:
            assert len(rows(bench.folder / "data.csv")) == 4
            return
        print(f"again, for the bench was late by {bench.latest_s * 1e3:.0f} ms: {done.stderr.splitlines()[-1]}")
    pytest.fail("the bench was late each time: is anything else running?")
