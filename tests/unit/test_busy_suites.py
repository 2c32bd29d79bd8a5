"""`make test-busy`: what it says of a turn is what the suite's own summary said."""

from __future__ import annotations

from all_parts import Part, summary
from drills.busy_suites import Turn

PASSED = Part("unit", seconds=604.4, tests=4412, skipped={"no zsh here": ["test_shell"]})
REPEATED = Part("clock", seconds=60.0, tests=25, repeated=["test_rate: other programs took 101% of a processor"])
FAILED = Part("processes", seconds=494.0, tests=606, failed=["test_gripper: it stayed closed"])
BEFORE = "unit …\n==== 1 failed in 3 s ====\nfailed:\n  what a test printed\n"


def test_turn_tells_the_tests_times_and_repetitions_of_the_summary() -> None:
    turn = Turn(2, "v1", 0, 1274.4, BEFORE + summary([PASSED, REPEATED]) + "\n")
    assert turn.is_well
    assert turn.line.splitlines() == [
        "turn 2: passed, 1274 s, arithmetic x86-64-v1; 4437 tests: unit 604 s, clock 60 s",
        "  repeated once: test_rate: other programs took 101% of a processor",
        "  skipped: no zsh here: test_shell",
    ]


def test_turn_that_failed_names_what_failed() -> None:
    turn = Turn(1, "", 2, 1338.0, BEFORE + summary([PASSED, FAILED]) + "\nmake: *** [test] Error 1\n")
    assert not turn.is_well
    assert turn.line.splitlines()[0].startswith("turn 1: FAILED (exit 2), 1338 s, arithmetic this processor's")
    assert turn.listed("failed") == ["test_gripper: it stayed closed"]


def test_turn_without_a_summary_is_no_success() -> None:
    assert not Turn(1, "", 0, 3.0, "pad demo: 1100 messages\n").is_well
