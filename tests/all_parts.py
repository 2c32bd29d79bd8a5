"""Parts of the tests, one after the other, even if one fails; then one summary, with what to report.

Without a name: all that `make test` consists of. The parts `long`, `mutations` and `slow` are run by their own targets.

Each part's output is shown and kept in build/test-logs/, with pytest's report as XML.
"""

from __future__ import annotations

import argparse
import math
import os
import select
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from repeating import REPEATED, family

ROOT = Path(__file__).parents[1]
LOGS = Path("build/test-logs")
PYTEST = ["-m", "pytest", "-o", "junit_logging=no", "-o", "junit_family=xunit1"]  # the older one names files
# A test that waits for what never comes ends its worker, which prints the stacks of all threads, and fails by its name.
TEST_LIMIT_S, PART_LIMIT_S = 360, 1200  # on two idle cores the longest test takes 45 s, the longest part 380 s
BOUNDED = [*PYTEST, "-o", f"faulthandler_timeout={TEST_LIMIT_S}", "-o", "faulthandler_exit_on_timeout=true"]
TURN_S = 0.5
OF_FUNCTIONS = ["tests/unit", "tests/skin", "tests/oracle", "tests/golden"]
BY_FILES = ["--dist", "loadfile", "--no-loadscope-reorder"]  # in tests/conftest.py's order, not by their counts
WHOLE = [word for folder in OF_FUNCTIONS for word in ("--ignore", folder)]
BY_STEALING = ["--dist", "worksteal"]
ONE_BY_ONE = ["--dist", "load", "--maxschedchunk", "1"]  # few tests, some long: none waits behind another long one
# Tests of whole processes mostly wait, so that four share two cores. Tests that are judged by the clock come last, and
# compute little; if this user may set priorities, other programs have to wait for them. Browsers and drills need a
# processor.
PARTS = {
    "lint": [["-m", "ruff", "check", "."], ["-m", "ruff", "format", "--check", "."],
             ["-m", "mypy", "--num-workers", "2", "daemon", "lab", "extras", "clients/python",
              "clients/mujoco/fmfts_mujoco"]],
    "unit": [[*BOUNDED, "-n", "3", *BY_FILES, *OF_FUNCTIONS, "-m", "not long and not mutation"]],
    "processes": [[*BOUNDED, "-n", "4", *BY_STEALING, *WHOLE,
                   "-m", "not real_time and not slow and not long and not mutation"]],
    "clock": [[*BOUNDED, "-n", "3", *ONE_BY_ONE, *WHOLE, "-m", "real_time and not slow"]],
    "slow": [[*PYTEST, "-n", "1", "--ignore", "tests/unit", "-m", "slow"]],  # a worker, as a test's limit ends it
    "long": [[*PYTEST, "-n", "2", "tests/unit", "tests/skin", "tests/firmware", "-m", "long"]],
    "mutations": [[*BOUNDED, "-n", "3", "tests/unit", "tests/firmware", "-m", "mutation"]],
}  # fmt: skip
BY_ITSELF = {"long", "mutations", "slow"}
FAVOURED = {"clock": -5, "slow": -5}  # niceness; with more, the kernel's own workers wait, which carry what a pty gets


@dataclass
class Part:
    """The result of one part."""

    name: str
    seconds: float = 0.0
    favoured: str = ""
    failed: list[str] = field(default_factory=list)
    repeated: list[str] = field(default_factory=list)
    skipped: dict[str, list[str]] = field(default_factory=dict)  # tests by reason
    tests: int = 0

    @property
    def log(self) -> Path:
        return LOGS / f"{self.name}.log"

    @property
    def report(self) -> Path:
        return LOGS / f"{self.name}.xml"


def run(part: Part, commands: list[list[str]]) -> None:
    """Run all of its commands; their output is shown, and written into its log."""
    part.report.unlink(missing_ok=True)
    start = time.monotonic()
    limit_s = math.inf if part.name in BY_ITSELF else PART_LIMIT_S
    until = start + limit_s
    with part.log.open("wb") as log:
        for words in commands:
            tests, failed_before = "pytest" in words, len(part.failed)
            command = [sys.executable, *words, *([f"--junit-xml={part.report}"] if tests else [])]
            with subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
            ) as process:
                if part.name in FAVOURED:
                    part.favoured = favour(process.pid, FAVOURED[part.name])
                assert process.stdout is not None
                os.set_blocking(process.stdout.fileno(), False)
                try:
                    while process.poll() is None and time.monotonic() < until:
                        select.select([process.stdout], [], [], TURN_S)
                        pass_on(process.stdout.fileno(), log)
                except KeyboardInterrupt:  # which a session of its own does not hear
                    os.killpg(process.pid, signal.SIGINT)
                    raise
                if overdue := process.poll() is None:
                    for one in family(process.pid):  # daemons and browsers have sessions of their own
                        with suppress(ProcessLookupError):
                            os.kill(one, signal.SIGKILL)
                process.wait()
                pass_on(process.stdout.fileno(), log)  # a process that it left behind may hold the pipe open
            if overdue:
                part.failed.append(f"{' '.join(words)}: did not end within {limit_s} s")
            if tests and part.report.exists():
                read(part)
            elif tests:
                part.failed.append(f"{' '.join(words)}: ended without a report")
            if process.returncode != 0 and len(part.failed) == failed_before:
                part.failed.append(f"{' '.join(words)}: ended with {process.returncode}")
    part.seconds = time.monotonic() - start


def pass_on(output: int, log: BinaryIO) -> None:
    """What can be read at once goes on, and into the log."""
    with suppress(BlockingIOError):
        while data := os.read(output, 65536):
            log.write(data)
            sys.stdout.buffer.write(data)
            sys.stdout.buffer.flush()


def favour(session: int, niceness: int) -> str:
    """Give all processes of this session priority. The kernel weighs sessions, then what is in each (sched(7),
    autogroup).

    Returns a phrase for the summary. An ordinary user may not do this: late tests are then repeated.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, session, niceness)
        with suppress(FileNotFoundError):
            Path(f"/proc/{session}/autogroup").write_text(str(niceness))
    except PermissionError:
        return "without priority over other programs, which only root may give"
    return f"other programs had to wait for it (niceness {niceness})"


def read(part: Part) -> None:
    for case in ET.parse(part.report).iter("testcase"):
        part.tests += 1
        name = name_of(case)
        for kind in ("failure", "error"):
            for bad in case.iter(kind):
                part.failed.append(f"{name}: {first_line(bad.get('message'))}")
        for skip in case.iter("skipped"):
            part.skipped.setdefault(first_line(skip.get("message")), []).append(name)
        for told in case.iter("property"):
            if told.get("name") == REPEATED:
                part.repeated.append(f"{name}: {told.get('value')}")


def name_of(case: ET.Element) -> str:
    """The name by which pytest finds it."""
    file = case.get("file", "")
    group = case.get("classname", "").removeprefix(file.removesuffix(".py").replace("/", ".")).lstrip(".")
    return "::".join(filter(None, [file, *group.split("."), case.get("name")]))


def first_line(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0]


def summary(parts: list[Part]) -> str:
    lines = ["", "=" * 78]
    for part in parts:
        tests = f"{part.tests} tests" if part.tests else ""
        verdict = "FAILED" if part.failed else "passed"
        lines.append(
            f"{part.name:<10}{verdict:<8}{part.seconds:5.0f} s  {tests:<12}{part.log}  {part.favoured}".rstrip()
        )
    for title, listed in (
        ("failed", [line for part in parts for line in part.failed]),
        ("repeated once, for the computer was busy", [line for part in parts for line in part.repeated]),
        ("skipped", [skipped(*each) for part in parts for each in part.skipped.items()]),
    ):
        if listed:
            lines += ["", f"{title}:", *(f"  {line}" for line in listed)]
    bad = [part for part in parts if part.failed]
    if bad:
        logs = " ".join(str(part.log) for part in bad)
        lines += ["", f"{len(bad)} of {len(parts)} parts failed. To report it: this summary, and {logs}"]
    return "\n".join(lines)


def skipped(reason: str, names: list[str]) -> str:
    return f"{reason}: {names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}"


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    names = options.parse_args().parts or [name for name in PARTS if name not in BY_ITSELF]
    if unknown := [name for name in names if name not in PARTS]:
        options.error(f"there is no part {unknown[0]}: {', '.join(PARTS)}")
    os.chdir(ROOT)
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # containers set it: each worker would compile all tests anew
    LOGS.mkdir(parents=True, exist_ok=True)
    parts = [Part(name) for name in names]
    for part in parts:
        print(f"\n{part.name} …", flush=True)
        run(part, PARTS[part.name])
    print(summary(parts), flush=True)
    return int(any(part.failed for part in parts))


if __name__ == "__main__":
    sys.exit(main())
