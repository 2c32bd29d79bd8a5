"""The fuzz targets over their kept corpora, by the C compiler and its sanitizers: past findings stay found.

`make -C firmware fuzz` continues from there with libFuzzer, a million inputs each.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("target", ["decoder", "requests"])
def test_board_agrees_with_wire_md_on_every_kept_input(target: str) -> None:
    built = subprocess.run(
        ["make", "-C", ROOT / "firmware", f"build/replay-{target}"], capture_output=True, text=True, timeout=120
    )
    assert built.returncode == 0, f"the fuzz target does not build:\n{built.stdout}{built.stderr}"
    inputs = sorted((ROOT / "tests/firmware/corpus" / target).iterdir())
    assert len(inputs) > 20, "the corpus is gone"
    replay = [ROOT / f"firmware/build/replay-{target}", *inputs]
    run = subprocess.run(replay, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr[-2000:]
    assert run.stdout == f"{len(inputs)} inputs\n"
