"""Changes equations, gates and memories of the product, one at a time, and runs the tests that should notice (`make
net-catches`).

Each change is one line of a copy of the product. The oracle or a golden replay must find it: first those nearest to it,
then all. A change that survives is a hole in the net, and ends the drill with 1.
"""

from __future__ import annotations

import argparse
import os
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from net_changes import CHANGES, Change

from fmfts.common.toml import tomllib

ROOT = Path(__file__).parents[2]
EVERYTHING = ("tests/oracle", "tests/golden")


@dataclass(frozen=True, slots=True)
class Extension:
    """One compiled part. flags: as pyproject.toml has them, without optimising: the bits are the same."""

    name: str
    sources: tuple[str, ...]
    flags: tuple[str, ...]

    @property
    def path(self) -> str:
        return f"daemon/{self.name.replace('.', '/')}.abi3.so"


def extensions() -> list[Extension]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    shared: list[str] = runpy.run_path(str(ROOT / "setup.py"))["FLAGS"]
    return [
        Extension(
            one["name"],
            tuple(one["sources"]),
            tuple(flag for flag in (*shared, *one.get("extra-compile-args", ())) if not flag.startswith(("-W", "-O"))),
        )
        for one in project["tool"]["setuptools"]["ext-modules"]
    ]


def within(change: Change) -> Path:
    """Where the changed file is in the repository."""
    return Path(change.path) if change.path.startswith("extras/") else Path("daemon/fmfts", change.path)


class Copy:
    """A copy of the product in which one file is replaced."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for part in ("daemon", "extras/skin"):
            shutil.copytree(ROOT / part, folder / part)
        self._objects: dict[tuple[str, str], Path] = {}

    def apply(self, change: Change) -> None:
        path = self.folder / within(change)
        text = path.read_text()
        if text.count(change.old) != 1:
            raise SystemExit(f"{change.path} has {text.count(change.old)} times {change.old!r}, not once: choose anew")
        path.write_text(text.replace(change.old, change.new))
        if path.suffix in (".c", ".h"):
            self._compile(path)

    def undo(self, change: Change) -> None:
        shutil.copy2(ROOT / within(change), self.folder / within(change))
        for one in extensions():
            if not change.path.endswith(".py"):
                shutil.copy2(ROOT / one.path, self.folder / one.path)

    def _compile(self, changed: Path) -> None:
        """Compile the parts that contain the file; if a source includes it, only those sources."""
        own = str(changed.relative_to(self.folder))
        for one in extensions():
            seen = [source for source in one.sources if source == own or self._includes(source, changed)]
            if seen:
                objects = [self._object(one, source, anew=source in seen) for source in one.sources]
                command = ["cc", "-shared", "-o", self.folder / one.path, *objects, "-lm"]
                subprocess.run(command, check=True)

    def _includes(self, source: str, header: Path) -> bool:
        if header.suffix != ".h":
            return False
        flags = f"-I{sysconfig.get_path('include')}"
        needs = subprocess.run(
            ["cc", "-MM", flags, source], cwd=self.folder, check=True, capture_output=True, text=True
        ).stdout
        return header.name in needs

    def _object(self, one: Extension, source: str, anew: bool) -> Path:
        key = (one.name, source)
        kept = self.folder / f"{one.name}-{source.replace('/', '-')}.o"
        if key in self._objects and not anew:
            return kept
        out = self.folder / f"changed-{source.replace('/', '-')}.o" if anew else kept
        include = f"-I{sysconfig.get_path('include')}"
        command = ["cc", "-c", "-fPIC", "-O1", *one.flags, include, source, "-o", out]
        subprocess.run(command, cwd=self.folder, check=True)
        if not anew:
            self._objects[key] = kept
        return out


def found_by(folder: Path, checks: tuple[str, ...]) -> str | None:
    """The name of the first check that fails, or None. A check is a test, or the name of a frozen world; after a colon,
    how many of its frames count."""
    paths = (folder / "daemon", folder / "extras/skin", ROOT / "tests", ROOT / "tests/unit")
    environment = os.environ | {"PYTHONPATH": ":".join(map(str, paths))}
    for check in checks:
        world, _, messages = check.partition(":")
        if "/" in check:
            command = ["-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", check]
        else:
            command = ["-m", "golden", world, *(["--messages", messages] if messages else [])]
        done = subprocess.run(
            [sys.executable, "-W", "ignore", *command], cwd=ROOT, env=environment, capture_output=True, text=True
        )
        if done.returncode:
            if failed := re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, flags=re.MULTILINE):
                return failed[1].rpartition("/")[2]
            differs = [line.strip() for line in done.stdout.splitlines() if line.startswith("    ")]
            return f"golden {world}: {differs[0]}" if differs else f"golden {world}: {done.stderr.strip()[-100:]}"
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="changes whose area or file has one of these, with commas")
    options = parser.parse_args()
    survivors, begun, count = [], time.monotonic(), 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        print(f"{'area':17} {'change':72} found by", flush=True)
        for change in CHANGES:
            if not any(part in change.area + change.path for part in options.only.split(",")):
                continue
            count += 1
            copy.apply(change)
            finder = found_by(copy.folder, change.checks) or found_by(copy.folder, EVERYTHING)
            copy.undo(change)
            if finder is None:
                survivors.append(change)
            print(f"{change.area:17} {change.summary:72} {(finder or 'NOTHING')[:110]}", flush=True)
    print(f"{count - len(survivors)} of {count} changes were found, in {time.monotonic() - begun:.0f} s")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
