"""`make demo` and `make test` several times in turn, beside busy processes: no test may fail (`make test-busy`).

Each turn is a fresh clone of HEAD on a plain Debian 12, to which the packages for the tests were added once. The turns
compute like this processor and like older ones. The drill continues after a failed turn, and finally reports how often
each test was repeated. The kernel shares the processors among sessions: both endless loops belong to this program, and
take about half of the computer's time. Each turn reports how much they took. Run as root.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from all_parts import PARTS  # noqa: E402
from drills.fresh_clone import DEMO, PROCESSORS, SEEN, FreshClone, end_on_sigterm, plain_debian  # noqa: E402
from repeating import TICKS_PER_S, own_ticks  # noqa: E402

LOGS = ROOT / "build/test-busy-logs"
TURNS_ON = ("", "v1", "v2", "", "v1")  # then from the start
LOOPS = 2
CORES = os.cpu_count() or 1
LOOP = """
import os, sys
while os.getppid() == int(sys.argv[1]):
    for _ in range(10**6):
        pass
"""
# As in the summary that tests/all_parts.py prints.
PART = re.compile(rf"(?m)^({'|'.join(PARTS)}) +(passed|FAILED) +(\d+) s +(?:(\d+) tests)?")
LISTS = ("failed", "repeated once", "skipped")
SECTION = r"(?ms)^{title}[^\n]*:\n((?:  [^\n]*\n?)+)"


@dataclass(frozen=True)
class Turn:
    """One suite. said: its output."""

    number: int
    cpu: str
    code: int
    seconds: float
    looped_s: float  # processor time of the endless loops
    said: str

    @property
    def summary(self) -> str:
        return self.said[max(self.said.rfind("=" * 78), 0) :]

    @property
    def verdict(self) -> str:
        if self.code != 0:
            return f"FAILED (exit {self.code})"
        if PART.search(self.summary) is None or SEEN.search(self.said) is None:
            return "FAILED (it ended well, and showed no contacts or ran no tests)"
        return "passed"

    @property
    def line(self) -> str:
        arithmetic = f"arithmetic of x86-64-{self.cpu}" if self.cpu else "this processor's arithmetic"
        found = PART.findall(self.summary)
        tests = sum(int(count or 0) for *_, count in found)
        parts = ", ".join(f"{name} {seconds} s" for name, _, seconds, _ in found)
        head = f"turn {self.number}: {self.verdict}, {self.seconds:.0f} s, {arithmetic}; {tests} tests: {parts}"
        of_all = f"{self.looped_s:.0f} s of the processors' {self.seconds * CORES:.0f} s"
        lists = [f"  {title}: {each}" for title in LISTS for each in self.listed(title)]
        return "\n".join([head, f"  the endless loops took {of_all}", *lists])

    def listed(self, title: str) -> list[str]:
        """The entries of the summary below `title`."""
        found = re.search(SECTION.format(title=title), self.summary)
        return [line.strip() for line in found[1].splitlines()] if found else []


def counted(turns: list[Turn]) -> str:
    """How often each test was repeated."""
    numbers: dict[str, list[int]] = {}
    for turn in turns:
        for each in turn.listed("repeated once"):
            numbers.setdefault(each.partition(": ")[0], []).append(turn.number)
    lines = [f"repeated in turns {each}: {test}" for test, each in numbers.items()]
    return "\n".join(lines or ["no test was repeated"])


@contextmanager
def busy() -> Iterator[Callable[[], float]]:
    """Endless loops, which end with this program. Gives a function that returns their processor time (s)."""
    loops = [subprocess.Popen([sys.executable, "-c", LOOP, str(os.getpid())]) for _ in range(LOOPS)]

    def took_s() -> float:
        require(all(loop.poll() is None for loop in loops), "an endless loop was ended: the computer was not busy")
        return sum(own_ticks(loop.pid) for loop in loops) / TICKS_PER_S

    try:
        yield took_s
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def with_packages(plain: Path, source: Path) -> Path:
    """The plain tree with the packages that `make` would install in each turn; made if absent."""
    tree = plain.with_name("debian-12-to-test")
    if not tree.exists():
        with FreshClone(plain, "root", {}, source) as clone:
            code, _ = clone.does("make base-packages test-packages")
            require(code == 0, "the packages that the tests need cannot be installed")
            shutil.rmtree(clone.project)
            making = Path(tempfile.mkdtemp(dir=tree.parent, prefix=f"{tree.name}."))
            try:
                subprocess.run(["cp", "-a", "--reflink=auto", f"{clone.root}/.", making], check=True)
            except BaseException:
                shutil.rmtree(making)
                raise
            making.rename(tree)
    return tree


def suite(number: int, tree: Path, source: Path, parts: list[str]) -> Turn:
    cpu, logs = TURNS_ON[(number - 1) % len(TURNS_ON)], LOGS / f"turn-{number}"
    test = f'make test PARTS="{" ".join(parts)}"' if parts else "make test"
    with FreshClone(tree, "root", PROCESSORS[cpu], source) as clone, busy() as looped_s:
        start = time.monotonic()
        code, said = clone.does(f"{DEMO} && {test}")
        turn = Turn(number, cpu, code, time.monotonic() - start, looped_s(), said)
        if (clone.project / "build/test-logs").is_dir():
            shutil.copytree(clone.project / "build/test-logs", logs)
    logs.mkdir(parents=True, exist_ok=True)
    (logs / "said.log").write_text(said)
    return turn


def require(condition: object, what: str) -> None:
    if not condition:
        raise SystemExit(f"test-busy: {what}")


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--turns", type=int, default=len(TURNS_ON))
    options.add_argument("--parts", nargs="*", choices=PARTS, default=[], help="of the tests; else all of `make test`")
    options.add_argument("--cache", type=Path, default=ROOT / "build", help="where the trees of Debian are kept")
    arguments = options.parse_args()
    require(arguments.turns > 0, f"--turns {arguments.turns}: at least one turn is needed")
    require(os.geteuid() == 0, "a tree of Debian is made and entered by root alone: sudo make test-busy")
    end_on_sigterm()
    shutil.rmtree(LOGS, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "head.git"  # the present commit, even if others follow
        subprocess.run(["git", "clone", "-q", "--bare", f"file://{ROOT}", source], check=True)
        git = ["git", "-C", source, "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(git, check=True, capture_output=True, text=True).stdout.strip()
        tree = with_packages(plain_debian(arguments.cache), source)
        turns = []
        for number in range(1, arguments.turns + 1):
            turns.append(suite(number, tree, source, arguments.parts))
            print(turns[-1].line, flush=True)
    print(f"\n{'=' * 78}\nat {commit}, beside {LOOPS} endless loops:")
    print("\n".join(each.line for each in turns))
    print(counted(turns))
    bad = [each for each in turns if each.verdict != "passed"]
    print(f"{len(bad)} of {len(turns)} turns failed; all logs are in {LOGS.relative_to(ROOT)}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
