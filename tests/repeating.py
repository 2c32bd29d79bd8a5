"""A test that is judged by the clock, and fails while other programs take this computer's processors, is repeated once.

A pytest plugin for tests that are marked `real_time`. Reports say how much the others took; the summary names repeated
tests.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

MARKER = "real_time"
WINDOW_S = 1.0
BUSY_SHARE = 0.25  # share of one processor in any second; an idle computer's own work takes a tenth of that
QUIET_WITHIN_S = 30.0  # before the second attempt
REPEATED, FIRST_FAILURE = "repeated", "first failure"  # names of a report's properties
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def all_ticks() -> int:
    """Busy ticks of all processors, including those that a hypervisor gave to others (proc_stat(5))."""
    user, nice, system, _, _, irq, softirq, steal = map(int, Path("/proc/stat").read_text().split()[1:9])
    return user + nice + system + irq + softirq + steal


def family(root: int) -> dict[int, list[str]]:
    """The process `root` and all that descend from it, whatever their session: of each what follows its name in
    proc_pid_stat(5)."""
    children: dict[int, list[int]] = {}
    said: dict[int, list[str]] = {}
    for process in Path("/proc").iterdir():
        if process.name.isdecimal():
            with suppress(OSError):  # it has ended since
                said[int(process.name)] = (process / "stat").read_text().rpartition(")")[2].split()
                children.setdefault(int(said[int(process.name)][1]), []).append(int(process.name))
    own = [root]
    for one in own:
        own += children.get(one, ())
    return {one: said[one] for one in own if one in said}


def own_ticks(root: int) -> int:
    """Of the process `root` and all that descend from it, those that have ended included."""
    return sum(sum(map(int, fields[11:15])) for fields in family(root).values())


class OthersShare:
    """The largest share of a processor that other programs took in any second, while this is open."""

    def __init__(self, root: int) -> None:
        self.largest = 0.0
        self._root = root
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def _watch(self) -> None:
        all_before, own_before = all_ticks(), own_ticks(self._root)
        over = False
        while not over:
            over = self._closing.wait(WINDOW_S)
            all_now, own_now = all_ticks(), own_ticks(self._root)
            others = all_now - all_before - max(own_now - own_before, 0)
            self.largest = max(self.largest, others / TICKS_PER_S / WINDOW_S)
            all_before, own_before = all_now, own_now

    @property
    def said(self) -> str:
        return f"other programs took {self.largest:.0%} of a processor in the busiest second"

    def __enter__(self) -> OthersShare:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> bool | None:
    if item.get_closest_marker(MARKER) is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports, others = attempt(item)
    first = next((report for report in reports if report.failed), None)
    if first is not None and others.largest > BUSY_SHARE:
        wait_for_quiet(root_of(item))
        first_reports = reports
        reports, later = attempt(item)
        if not any(report.when == "call" and not report.skipped for report in reports):
            reports = first_reports  # a test that was skipped the second time has not passed
        said = f"{others.said}, and {later.largest:.0%} when it was repeated"
        for report in reports:
            report.user_properties += [(REPEATED, said), (FIRST_FAILURE, first.longreprtext)]
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def root_of(item: pytest.Item) -> int:
    """With xdist this process is one of several workers, whose tests do not count as strangers."""
    return os.getppid() if hasattr(item.config, "workerinput") else os.getpid()


def wait_for_quiet(root: int) -> None:
    """Waits for quiet; if it does not come, the second attempt must do without."""
    until = time.monotonic() + QUIET_WITHIN_S
    while time.monotonic() < until:
        with OthersShare(root) as others:
            time.sleep(2 * WINDOW_S)
        if others.largest <= BUSY_SHARE:
            return


def attempt(item: pytest.Item) -> tuple[list[pytest.TestReport], OthersShare]:
    """Run it with fixtures of its own, which no other test and no later attempt gets."""
    with OthersShare(root_of(item)) as others:
        reports = runtestprotocol(item, log=False, nextitem=None)
    for report in reports:
        if report.failed:
            report.sections.append(("this computer meanwhile", others.said))
    return reports, others


def repeated(reporter: pytest.TerminalReporter) -> Iterator[tuple[str, dict[str, str]]]:
    for reports in reporter.stats.values():
        for report in reports:
            properties = dict(getattr(report, "user_properties", ()))
            if REPEATED in properties and report.when == "teardown":
                yield report.nodeid, properties


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    for node, properties in repeated(terminalreporter):
        terminalreporter.section(f"repeated once: {node}")
        terminalreporter.write_line(properties[REPEATED] + "; the first time:")
        terminalreporter.write_line(properties[FIRST_FAILURE])
