"""`make test-busy`: its report of a turn agrees with the tests' own summary."""

from __future__ import annotations

import time

import pytest

from all_parts import Part, summary
from drills.busy_suites import CORES, Turn, busy, counted

PASSED = Part("unit", seconds=604.4, tests=4412, skipped={"no zsh here": ["test_shell"]})
REPEATED = Part(
    "clock",
    seconds=60.0,
    tests=25,
    favoured="other programs had to wait for it (niceness -5)",
    repeated=["test_rate: other programs took 101% of a processor"],
)
FAILED = Part("processes", seconds=494.0, tests=606, failed=["test_gripper: it stayed closed"])
DEMO = "pad demo: 1100 messages; 220.1 Hz; 0 lost; 2 touches, hardest 1.04 N; ok 5.0 s\n"
BEFORE = DEMO + "unit …\n==== 1 failed in 3 s ====\nfailed:\n  what a test printed\n"


def turn(said: str, number: int = 2, code: int = 0, cpu: str = "v1") -> Turn:
    return Turn(number, cpu, code, 1274.4, 1250.0, said)


def test_turn_reports_test_times_and_repetitions_from_summary() -> None:
    assert turn(BEFORE + summary([PASSED, REPEATED]) + "\n").line.splitlines() == [
        "turn 2: passed, 1274 s, arithmetic of x86-64-v1; 4437 tests: unit 604 s, clock 60 s",
        f"  the endless loops took 1250 s of the processors' {1274.4 * CORES:.0f} s",
        "  repeated once: test_rate: other programs took 101% of a processor",
        "  skipped: no zsh here: test_shell",
    ]


def test_turn_that_failed_names_what_failed() -> None:
    told = turn(BEFORE + summary([PASSED, FAILED]) + "\nmake: *** [test] Error 1\n", code=2, cpu="")
    assert told.line.startswith("turn 2: FAILED (exit 2), 1274 s, this processor's arithmetic; 5018 tests")
    assert told.listed("failed") == ["test_gripper: it stayed closed"]


@pytest.mark.parametrize("said", [DEMO, summary([PASSED]), ""])
def test_turn_without_tests_or_without_contacts_in_demo_is_no_success(said: str) -> None:
    assert turn(said).verdict.startswith("FAILED (it ended well, and ")


def test_repetitions_are_counted_by_test() -> None:
    said = BEFORE + summary([REPEATED])
    assert counted([turn(said, 1), turn(BEFORE + summary([PASSED]), 2), turn(said, 4)]) == (
        "repeated in turns [1, 4]: test_rate"
    )
    assert counted([turn(BEFORE + summary([PASSED]))]) == "no test was repeated"


def test_endless_loops_take_processor_time_until_they_are_ended() -> None:
    with busy() as took_s:
        until = time.monotonic() + 60.0
        while took_s() < 0.2:
            assert time.monotonic() < until
            time.sleep(0.05)
