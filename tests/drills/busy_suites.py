"""`make demo` and `make test` several times in turn, beside busy processes: no test may fail (`make test-busy`).

Each turn is a fresh clone of HEAD on a plain Debian 12, turn by turn with the arithmetic of this processor and of older
ones. The endless loops run in this program's own session, so that the kernel gives them half of the computer's time.
It goes on after a turn that failed, and keeps that turn's logs. Run as root.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from all_parts import PARTS  # noqa: E402
from drills.fresh_clone import DEMO, PROCESSORS, FreshClone, end_on_sigterm, plain_debian  # noqa: E402

LOGS = ROOT / "build/test-busy-logs"
TURNS_ON = ("", "v1", "v2", "", "v1")  # then from the start
LOOPS = 2
LOOP = "while True: pass"
# Of the summary that tests/all_parts.py prints.
PART = re.compile(rf"(?m)^({'|'.join(PARTS)}) +(passed|FAILED) +(\d+) s +(?:(\d+) tests)?")
LISTS = ("failed", "repeated once", "skipped")
SECTION = r"(?ms)^{title}[^\n]*:\n((?:  [^\n]*\n)+)"


@dataclass(frozen=True)
class Turn:
    """One suite. said: all that it printed."""

    number: int
    cpu: str
    code: int
    seconds: float
    said: str

    @property
    def summary(self) -> str:
        return self.said[max(self.said.rfind("=" * 78), 0) :]

    @property
    def is_well(self) -> bool:
        """A suite that ran nothing proves nothing."""
        return self.code == 0 and PART.search(self.summary) is not None

    @property
    def line(self) -> str:
        arithmetic = f"x86-64-{self.cpu}" if self.cpu else "this processor's"
        verdict = "passed" if self.is_well else f"FAILED (exit {self.code})"
        found = PART.findall(self.summary)
        tests = sum(int(count or 0) for *_, count in found)
        parts = ", ".join(f"{name} {seconds} s" for name, _, seconds, _ in found)
        head = f"turn {self.number}: {verdict}, {self.seconds:.0f} s, arithmetic {arithmetic}; {tests} tests: {parts}"
        more = [f"  {title}: {each}" for title in LISTS for each in self.listed(title)]
        return "\n".join([head, *more])

    def listed(self, title: str) -> list[str]:
        """What the summary lists below `title`."""
        found = re.search(SECTION.format(title=title), self.summary)
        return [line.strip() for line in found[1].splitlines()] if found else []


@contextmanager
def busy() -> Iterator[None]:
    loops = [subprocess.Popen([sys.executable, "-c", LOOP]) for _ in range(LOOPS)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def with_packages(plain: Path) -> Path:
    """The plain tree with the packages that `make` would install in each turn; made when it is not there yet."""
    tree = plain.with_name("debian-12-to-test")
    if not tree.exists():
        with FreshClone(plain, "root", {}) as clone:
            code, _ = clone.does("make base-packages test-packages")
            require(code == 0, "the packages that the tests need cannot be installed")
            shutil.rmtree(clone.project)
            making = tree.with_suffix(".making")
            shutil.rmtree(making, ignore_errors=True)
            subprocess.run(["cp", "-a", "--reflink=auto", clone.root, making], check=True)
            making.rename(tree)
    return tree


def turn(number: int, tree: Path, commit: str, parts: list[str]) -> Turn:
    cpu = TURNS_ON[(number - 1) % len(TURNS_ON)]
    test = f'make test PARTS="{" ".join(parts)}"' if parts else "make test"
    with FreshClone(tree, "root", PROCESSORS[cpu], commit) as clone, busy():
        start = time.monotonic()
        code, said = clone.does(f"{DEMO} && {test}")
        ended = Turn(number, cpu, code, time.monotonic() - start, said)
        if code != 0 and (clone.project / "build/test-logs").is_dir():
            shutil.copytree(clone.project / "build/test-logs", LOGS / f"turn-{number}")
    return ended


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
    git = ["git", "-C", ROOT, "rev-parse", "HEAD"]
    commit = subprocess.run(git, check=True, capture_output=True, text=True).stdout.strip()
    tree = with_packages(plain_debian(arguments.cache))
    turns = []
    for number in range(1, arguments.turns + 1):
        turns.append(turn(number, tree, commit, arguments.parts))
        print(turns[-1].line, flush=True)
    print(f"\n{'=' * 78}\nat {commit[:8]}, beside {LOOPS} endless loops:")
    print("\n".join(each.line for each in turns))
    bad = [each for each in turns if not each.is_well]
    print(f"{len(bad)} of {len(turns)} turns failed" + (f"; logs are in {LOGS.relative_to(ROOT)}" if bad else ""))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
