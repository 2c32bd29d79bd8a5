"""What is judged by the clock and failed on a busy computer is repeated once, and that is said; nothing else is."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import repeating
from standing_still import StandingStill

pytest_plugins = ["pytester"]

FAILS = """
import pathlib, pytest, repeating

repeating.BUSY_SHARE, repeating.QUIET_WITHIN_S = {busy_share}, 0.0
tried = pathlib.Path("tried")

@pytest.fixture(scope="module")
def fresh():
    return []

@pytest.mark.{marker}
def test_that_fails(fresh, record_property):
    with tried.open("a") as file:
        file.write("x")
    fresh.append(1)
    assert len(fresh) == 1, "what the first attempt made"
    assert len(tried.read_text()) > {failures}, "too late"
"""
ALWAYS_BUSY, NEVER_BUSY = -1.0, 1e9


@pytest.fixture(autouse=True)
def few_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """The inner runs start sooner."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")


def run(pytester: pytest.Pytester, *options: str, **words: object) -> tuple[pytest.RunResult, int]:
    """The inner run, and how often its test was tried."""
    pytester.makeini(f"[pytest]\nmarkers =\n    real_time\n    other\npythonpath = {Path(repeating.__file__).parent}")
    pytester.makeconftest('pytest_plugins = ["repeating"]')
    pytester.makepyfile(FAILS.format(**{"marker": "real_time", "busy_share": ALWAYS_BUSY} | words))
    result = pytester.runpytest_subprocess(*options)
    return result, len(Path("tried").read_text())


@contextmanager
def busy_process() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            yield process
        finally:
            process.kill()


def processor_s(process: int) -> float:
    return repeating.own_ticks(process) / repeating.TICKS_PER_S


@pytest.mark.parametrize("options", [(), ("-p", "xdist", "-n", "1")])
def test_repeated_once_with_all_made_anew_and_said(pytester: pytest.Pytester, options: tuple[str, ...]) -> None:
    result, tried = run(pytester, *options, "--junit-xml=report.xml", failures=1)
    assert (result.ret, tried) == (0, 2)
    result.stdout.fnmatch_lines(
        ["*repeated once: *::test_that_fails*", "*other programs took *, and *% when it was repeated*"]
    )
    assert "too late" in result.stdout.str(), "why it failed the first time"
    assert 'name="repeated" value="other programs took' in Path("report.xml").read_text()


def test_failed_test_is_repeated_once_only(pytester: pytest.Pytester) -> None:
    result, tried = run(pytester, failures=2)
    assert (result.ret, tried) == (1, 2)
    result.stdout.fnmatch_lines(["*this computer meanwhile*"])


@pytest.mark.parametrize("words", [{"busy_share": NEVER_BUSY}, {"marker": "other"}])
def test_idle_computer_or_judged_failure_is_not_repeated(pytester: pytest.Pytester, words: dict[str, object]) -> None:
    result, tried = run(pytester, failures=1, **words)
    assert (result.ret, tried) == (1, 1)


@pytest.fixture
def short_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thirty ticks of the kernel's clock."""
    monkeypatch.setattr(repeating, "WINDOW_S", 0.3)


@pytest.mark.usefixtures("short_windows")
def test_processes_of_others_are_noticed() -> None:
    with busy_process() as stranger, busy_process() as own, repeating.OthersShare(own.pid) as others:
        wait_for(stranger.pid, 0.6)
    assert others.largest > repeating.BUSY_SHARE


def test_child_processes_of_tests_are_not_foreign() -> None:
    before_s = processor_s(os.getpid()) - time.process_time()
    with busy_process() as child:
        wait_for(child.pid, 0.5)
        assert processor_s(os.getpid()) - time.process_time() > before_s + 0.4
    assert processor_s(os.getpid()) - time.process_time() > before_s + 0.4, "though it has ended"


def wait_for(process: int, seconds: float) -> None:
    """Of processor time."""
    end_s, until = processor_s(process) + seconds, time.monotonic() + 60.0
    while processor_s(process) < end_s:
        assert time.monotonic() < until
        time.sleep(0.1)


def test_processor_that_stands_still_is_told_of_with_when() -> None:
    with StandingStill() as computer:
        time.sleep(0.1)
        start = time.monotonic()
        hold_the_interpreter(0.2)  # so that no thread of this process runs, as when all of it is stopped
        end = time.monotonic()
        time.sleep(0.1)
    assert computer.within(start, end)
    assert any(began < end and ended - began >= 0.19 for began, ended in computer.times)
    assert not computer.within(0.0, min(began for began, _ in computer.times))


def hold_the_interpreter(seconds: float) -> None:
    usleep = ctypes.PyDLL(None).usleep  # unlike CDLL, it keeps the interpreter's lock
    usleep(round(seconds * 1e6))


@pytest.mark.usefixtures("short_windows")
def test_second_attempt_waits_until_strangers_have_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repeating, "QUIET_WITHIN_S", 3.0)
    monkeypatch.setattr(repeating, "BUSY_SHARE", 0.8)  # share of other programs here: little; of a busy process: all
    with busy_process() as stranger, busy_process() as own:
        ended = threading.Timer(1.0, stranger.kill)
        ended.start()
        start = time.monotonic()
        repeating.wait_for_quiet(own.pid)
        assert time.monotonic() - start > 1.0
        assert stranger.wait(0.0) is not None
