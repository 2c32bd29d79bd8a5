"""Each Python with the oldest, the newest and the pinned versions that pyproject.toml allows: `make test-versions`.

Pythons are those on PATH and of pyenv, and those that uv can fetch. Only wheels are used: users cannot install a
version without a wheel for their Python. An environment with a failure stays in build/versions.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import Any

from uv import find_uv_bin

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from drills.aarch64 import load_compiled  # noqa: E402
from end_to_end.processes import RunningDaemon  # noqa: E402

RESOLUTIONS = {"oldest": "lowest-direct", "newest": "highest", "pinned": "highest"}
# Written by `make constraints`; uv compares the hashes in these files, too.
PINNED = [ROOT / "release" / f"constraints{part}.txt" for part in ("", "-extras")]
# They take minutes of statistics, and use no interface of a dependency that others do not use.
SLOW = ["paper_studies", "neighbours", "needs", "rebaselining", "baseline_refine", "baseline_turn", "bench_contact"]
SLOW += ["fault_drills"]
# unicorn and pyocd, which no unit test imports, have their tests with the firmware.
TESTS = ["tests/unit", "tests/skin", "tests/firmware/test_emulator_i2c.py", "tests/firmware/test_stm32_registers.py"]
TESTS += [f"--ignore=tests/unit/test_{name}.py" for name in SLOW]
# Ten examples of each property: these tests look for a missing or changed interface.
OPTIONS = ["-q", "-n", "2", "--dist", "loadfile", "-p", "no:cacheprovider", "--hypothesis-profile=few"]
# An old package on newer ones, or on a newer Python, uses deprecated interfaces, and nobody mends it any more.
OLD_PACKAGES_MAY_WARN = ["-W", "ignore::DeprecationWarning", "-W", "ignore::PendingDeprecationWarning"]
PAD = """
[[pad]]
name = "demo"
[pad.source]
type = "simulated"
"""
LISTENER = """
from fmfts_client import Client, request
with Client("demo") as pad:
    contacts = [pad.latest(timeout_s=5.0) for _ in range(100)]
assert all(contact is not None and contact.valid for contact in contacts), contacts[-1]
assert "demo" in str(request("pads"))
"""
Outcome = tuple[str, bool]  # text for the table; true if everything passed


@dataclass(frozen=True)
class Project:
    folder: Path
    extras: tuple[str, ...] = ()

    @cached_property
    def described(self) -> dict[str, Any]:
        return tomllib.loads((self.folder / "pyproject.toml").read_text())

    @property
    def name(self) -> str:
        return str(self.described["project"]["name"])

    @cached_property
    def bounds(self) -> dict[str, str]:
        """The least version of each dependency; "" if any will do."""
        extras = self.described["project"].get("optional-dependencies", {}).values()
        words = (
            self.described["project"]["dependencies"] + self.of_beside + [word for extra in extras for word in extra]
        )
        found = (re.match(r"([\w.-]+)(?:\[.*\])?(?:>=([\d.]+))?", word) for word in words)
        return {each[1]: each[2] or "" for each in found if each and each[1] != self.name}

    @property
    def beside(self) -> list[Path]:
        """Packages whose verbs are tried, too."""
        return [path.parent for place in ("lab", "extras/*") for path in self.folder.glob(f"{place}/pyproject.toml")]

    @property
    def of_beside(self) -> list[str]:
        """The requirements of these packages."""
        words = [word for folder in self.beside for word in Project(folder).described["project"]["dependencies"]]
        return [word for word in words if not word.startswith("fmfts")]

    def pythons(self) -> tuple[list[str], list[str]]:
        """The named Pythons and any other allowed one at hand: those available here, and those that are not."""
        listed = json.loads(uv("python", "list", "--only-installed", "--output-format", "json"))
        plain = [each for each in listed if each["implementation"] == "cpython" and each["variant"] == "default"]
        at_hand = {".".join(each["version"].split(".")[:2]) for each in plain}
        classifiers = " ".join(self.described["project"]["classifiers"])
        named = set(re.findall(r"Python :: (\d+\.\d+)", classifiers))
        least = numbers(self.described["project"]["requires-python"])
        had: list[str] = []
        lacking: list[str] = []
        for python in sorted(at_hand | named, key=numbers):
            if numbers(python) >= least:
                (had if python in at_hand or fetched(python) else lacking).append(python)
        return had, lacking


CLIENT = Project(ROOT / "clients/python")


@dataclass(frozen=True)
class Trial:
    python: str
    end: str
    versions: dict[str, str]
    outcome: str
    well: bool

    def cell(self, name: str, bound: str) -> str:
        version = self.versions.get(name, "")
        younger = self.end == "oldest" and bound and numbers(version) > numbers(bound)
        return version + "*" * bool(younger)


def numbers(version: str) -> list[int]:
    """In a comparable form: 3.5 is 3.5.0."""
    found = [int(number) for number in re.findall(r"\d+", version)]
    while found and found[-1] == 0:
        found.pop()
    return found


@cache
def environment() -> dict[str, str]:
    """With pyenv's Pythons after all others: among its own commands for them, only the chosen version's works."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    return os.environ | {"PATH": os.pathsep.join([os.environ["PATH"], *map(str, sorted(pyenv.glob("*/bin")))])}


def uv(*words: str | Path) -> str:
    command = [find_uv_bin(), *map(str, words)]
    ended = subprocess.run(command, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise RuntimeError(f"uv {' '.join(command[1:])}: {ended.stderr.strip()}")
    return ended.stdout


def fetched(python: str) -> bool:
    try:
        uv("python", "install", python)
    except RuntimeError:
        return False
    return True


def wheel(project: Project, python: str, end: str, folder: Path) -> Path:
    """Through the source archive, with the oldest or the newest setuptools."""
    needs, pinned = folder / "needs.in", folder / "pinned.txt"
    needs.write_text("\n".join(project.described["build-system"]["requires"]))
    pinned.write_text(uv("pip", "compile", "--resolution", RESOLUTIONS[end], "--python", python, needs))
    uv("build", "--python", python, "--build-constraints", pinned, "--out-dir", folder, project.folder)
    (built,) = folder.glob(f"{project.name.replace('-', '_')}-[0-9]*.whl")
    return built


def installed(project: Project, python: str, end: str, folder: Path) -> dict[str, str]:
    """Into a new environment; returns the versions there of the packages that the project names."""
    uv("venv", "--python", python, folder)
    extras = [word for extra in project.extras for word in ("--extra", extra)]
    from_wheels = ["--only-binary", ":all:", "--resolution", RESOLUTIONS[end]]
    # The client of this checkout: no index has it.
    client = [] if project.name == CLIENT.name else [wheel(CLIENT, python, end, folder)]
    pinned = [word for file in PINNED if end == "pinned" for word in ("--constraints", file)]
    uv(
        "pip",
        "install",
        "--python",
        folder,
        *from_wheels,
        *pinned,
        "-r",
        project.folder / "pyproject.toml",
        *extras,
        *client,
        *project.of_beside,
    )
    uv("pip", "install", "--python", folder, "--no-deps", wheel(project, python, end, folder), *project.beside)
    listed = json.loads(uv("pip", "list", "--python", folder, "--format", "json"))
    return {each["name"]: each["version"] for each in listed if each["name"] in project.bounds}


def run_tests(folder: Path, end: str, tests: list[str]) -> Outcome:
    load_compiled([folder / "bin/python"])
    report = folder / "report.xml"
    warnings = OLD_PACKAGES_MAY_WARN if end == "oldest" else []
    command = [folder / "bin/python", "-m", "pytest", *OPTIONS, *warnings, f"--junit-xml={report}", *tests]
    code = subprocess.run(command, cwd=ROOT, check=False).returncode
    if not report.exists():
        return f"pytest: exit {code}", False
    counted = {key: int(value) for key, value in ET.parse(report).getroot()[0].items() if value.isdecimal()}
    failed = counted["failures"] + counted["errors"]
    return f"{counted['tests'] - failed - counted['skipped']}/{failed}/{counted['skipped']}", code == 0


def run_client(folder: Path, base: str) -> Outcome:
    command = [folder / "bin/python", "-W", "error", "-c", LISTENER]
    code = subprocess.run(command, env=os.environ | {"FMFTS_BUS": base}, check=False).returncode
    return "failed" if code else "passed", code == 0


def tried(project: Project, ends: list[str], only: list[str], judge: Callable[[Path, str], Outcome]) -> bool:
    """Test each Python with each set, and print a table; returns whether all passed."""
    had, lacking = project.pythons()
    had = [python for python in had if not only or python in only]
    trials = []
    for end, python in product(ends, had):
        folder = ROOT / "build/versions" / f"{project.name}-{python}-{end}"
        folder.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(folder, ignore_errors=True)  # removes a failed trial; trials of others may run meanwhile
        print(f"{project.name}: Python {python}, {end} dependencies", flush=True)
        versions: dict[str, str] = {}
        try:
            versions = installed(project, python, end, folder)
            outcome, well = judge(folder, end)
        except RuntimeError as failure:
            print(failure, flush=True)
            outcome, well = "not installed", False
        if well:
            shutil.rmtree(folder)
        trials.append(Trial(python, end, versions, outcome, well))
    print_table(project, trials, lacking)
    return all(trial.well for trial in trials)


def print_table(project: Project, trials: list[Trial], lacking: list[str]) -> None:
    rows = [[project.name, *(f"{trial.python} {trial.end}" for trial in trials)]]
    for name, bound in sorted(project.bounds.items()):
        if any(name in trial.versions for trial in trials):
            rows.append([f"{name} >={bound}" if bound else name, *(trial.cell(name, bound) for trial in trials)])
    rows.append(["passed/failed/skipped", *(trial.outcome for trial in trials)])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    print()
    for row in rows:
        print("  ".join(map(str.ljust, row, widths)).rstrip())
    print("*: the oldest that can be installed for this Python")
    for python in lacking:
        print(f"Python {python}: not tried, for it is not on PATH, and uv cannot fetch it here")
    print(flush=True)


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--python", action="append", default=[], help="only this one, such as 3.12; may be repeated")
    options.add_argument("--set", choices=RESOLUTIONS, help="only this one")
    options.add_argument("tests", nargs="*", default=TESTS, help="of the daemon; the client has one trial alone")
    chosen = options.parse_args()
    ends = [chosen.set] if chosen.set else list(RESOLUTIONS)
    client, daemon = CLIENT, Project(ROOT, ("test", "fem"))
    with tempfile.TemporaryDirectory() as folder, RunningDaemon(Path(folder), PAD) as serving:
        well = tried(client, ends, chosen.python, lambda place, _: run_client(place, serving.base))
    return not (tried(daemon, ends, chosen.python, lambda place, end: run_tests(place, end, chosen.tests)) and well)


if __name__ == "__main__":
    sys.exit(main())
