"""`collect` on emulated machines that speak their real protocols on ptys: it fills the table without a person."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from end_to_end.collecting_bench import PressedBench
from fmfts.bus.messages import FrameMessage
from fmfts_recording.file import read
from fmfts_recording.replay import Replay

TWO_PLACES = "[lattice]\nfirst_mm = [-4, 2]\nspacing_mm = 6\ncount = [2, 1]\nforces_n = [0.6, 1.2]\n"


def plan(folder: Path, text: str = TWO_PLACES) -> Path:
    path = folder / "grid.toml"
    path.write_text(text)
    return path


def rows(path: Path, *, unloaded: bool = False) -> list[dict[str, str]]:
    """The presses of a table, or readings of the unloaded pad before them; without an unfinished line."""
    whole, _, _ = path.read_text().rpartition("\n")
    return [row for row in csv.DictReader(whole.splitlines()) if (row["press"] == "0") == unloaded] if whole else []


def frames_behind(row: dict[str, str], folder: Path) -> int:
    """How many frames of a row its recording holds."""
    first_ns, last_ns = int(row["first_frame_ns"]), int(row["last_frame_ns"])
    messages = [recorded.message for recorded in read(folder / row["recording"])]
    return sum(
        isinstance(message, FrameMessage) and first_ns <= message.host_time_ns <= last_ns for message in messages
    )


@pytest.mark.parametrize(("dialect", "load_cell"), [("marlin", False), ("grbl", True)])
def test_plan_is_collected_with_no_hand_on_it(tmp_path: Path, dialect: str, load_cell: bool) -> None:
    with PressedBench(tmp_path, dialect, load_cell=load_cell) as bench:
        bench.record_baseline()
        facts = bench.collect(plan(tmp_path), tmp_path / "data.csv")
        assert bench.rod_is_up()
    assert facts["collected"] == 4
    collected = rows(tmp_path / "data.csv")
    for row, (x_mm, force_n) in zip(collected, [(-4, 0.6), (-4, 1.2), (2, 0.6), (2, 1.2)], strict=True):
        assert (float(row["x_mm"]), float(row["y_mm"])) == (x_mm, 2.0)
        # FORCE_TOLERANCE, and the error that the gauge's noise of 5 mN leaves in its three readings at the last step
        assert float(row["force_n"]) == pytest.approx(force_n, abs=0.05 * force_n + 0.02)
        field_ut = [float(row[f"b{sensor}{axis}_ut"]) for sensor in range(1, 5) for axis in "xyz"]
        true_ut = bench.magnet_field_t(x_mm * 1e-3, 2e-3, float(row["force_n"])).ravel() * 1e6
        # 0.2 µT of noise in 66 frames; 5 mN of the gauge are 0.3 µT; a baseline at rest leaves the rest field to 0.1 µT
        np.testing.assert_allclose(field_ut, true_ut, atol=1.0)
    assert [frames_behind(row, tmp_path) for row in collected] == [int(row["frames"]) for row in collected]
    assert len(list(Replay(tmp_path / "data.1.mcap").contacts())) >= sum(int(row["frames"]) for row in collected)
    rest = rows(tmp_path / "data.csv", unloaded=True)
    assert [(row["x_mm"], float(row["force_n"])) for row in rest] == [("-4.0000", 0.0), ("2.0000", 0.0)]
