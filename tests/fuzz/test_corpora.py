"""The fuzz targets over the kept corpus: past findings stay found. `make fuzz` continues from there."""

from __future__ import annotations

import fcntl
import math
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import peers

ROOT = Path(__file__).parents[2]
PATIENCE_S = 300  # six seconds of processor time, under sanitizers, on a busy computer
TARGETS = ("wire", "clock", "tables", "frame")


@pytest.fixture(scope="module")
def programs() -> dict[str, Path]:
    if not shutil.which("gcc"):
        pytest.skip("gcc is not installed")
    programs = {target: ROOT / f"build/fuzz/replay-{target}" for target in TARGETS}
    names = [str(program.relative_to(ROOT)) for program in programs.values()]
    make = ["make", "-f", "tests/fuzz/fuzz.mk", "-j3", *names]  # the Makefile would ask for Debian packages first
    (ROOT / "build").mkdir(exist_ok=True)
    with (ROOT / "build/fuzz.lock").open("w") as one_at_a_time:  # tests run in several processes
        fcntl.flock(one_at_a_time, fcntl.LOCK_EX)
        built = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert built.returncode == 0, f"the fuzz targets do not build:\n{built.stdout}{built.stderr}"
    return programs


@pytest.mark.parametrize("target", TARGETS)
def test_c_reads_every_kept_input(programs: dict[str, Path], target: str) -> None:
    inputs = sorted((ROOT / "tests/corpus" / target).iterdir())
    assert len(inputs) > 20, "the corpus is gone"
    run = subprocess.run([programs[target], *inputs], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert run.returncode == 0, run.stderr[-2000:]
    assert run.stdout == f"{len(inputs)} inputs\n"


@pytest.mark.parametrize("target", ["control", "messages"])
def test_damaged_message_is_refused_in_one_way(target: str) -> None:
    said = peers.fuzzed(target, 1, range(3000), math.inf)
    assert said.total() == 3000
    assert min(said["read"], said["refused"]) > 100
