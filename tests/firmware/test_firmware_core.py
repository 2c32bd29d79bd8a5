"""Builds the firmware core for the host and runs its C tests, plain and under the sanitizers."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VECTORS = ROOT / "tests/data/wire_vectors.ini"


@pytest.mark.parametrize("program", ["test-core", "test-core-sanitized"])
def test_firmware_core_passes_its_own_tests(program: str) -> None:
    built = subprocess.run(
        ["make", "-C", ROOT / "firmware", f"build/{program}"], capture_output=True, text=True, timeout=120
    )
    assert built.returncode == 0, f"the firmware core does not build:\n{built.stdout}{built.stderr}"
    run = subprocess.run([ROOT / "firmware/build" / program, VECTORS], capture_output=True, text=True, timeout=120)
    failures = [line for line in run.stdout.splitlines() if not line.startswith("ok ")]
    assert run.returncode == 0, "\n".join(failures) + run.stderr
    assert run.stdout.count("ok ") > 80, "the C tests were not all found"
