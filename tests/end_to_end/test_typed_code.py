"""The first Python of the READMEs, run as it stands beside a daemon that simulates its pad."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from end_to_end.processes import RunningDaemon

ROOT = Path(__file__).parents[2]
SIMULATED = '[[pad]]\nname = "{}"\n[pad.source]\ntype = "simulated"\nturning_deg_per_s = 0.0\n'
PADS = SIMULATED.format("demo") + SIMULATED.format("left")
PATIENCE_S = 60.0


def first_python(page: Path) -> str:
    block = re.search(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    assert block is not None
    return block[1]


@pytest.mark.parametrize("page", ["README.md", "clients/python/README.md"])
def test_first_python_of_readme_runs(page: str, tmp_path: Path) -> None:
    """A program that reads for ever is ended after its first output."""
    with RunningDaemon(tmp_path, PADS) as daemon:
        words = [sys.executable, "-u", "-W", "error", "-c", first_python(ROOT / page)]
        environment = os.environ | {"FMFTS_BUS": daemon.base}
        with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as ran:
            assert ran.stdout is not None
            assert ran.stderr is not None
            if "while True" in words[-1]:
                assert re.match(r"open the gripper|( ?-?[\d.]+(e-\d+)?){3,4}$", ran.stdout.readline())
                ran.kill()
            else:
                assert ran.wait(PATIENCE_S) == 0
            assert ran.stderr.read() == ""
