"""A damaged baseline of one pad: the other pads continue, and a new recording mends it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from end_to_end.processes import PATIENCE_S, UNTOUCHED_CONFIG, RunningDaemon

STILL = UNTOUCHED_CONFIG + "turning_deg_per_s = 0\n"
TWO_PADS = STILL + STILL.replace('"left"', '"right"')
# A simulated pad makes a baseline by itself if there is no file; a damaged file is no reason to do so.
FILE = Path("state/fmfts/baseline/left.json")


def not_utf8(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"left", b"le\xfft", 1))


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("damage", [not_utf8, pipe, folder])
def test_damaged_baseline_of_one_pad_stops_no_other_and_is_mended(
    tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    with RunningDaemon(tmp_path, TWO_PADS) as daemon:
        daemon.request("baseline", pad="left", rest=True, duration_s=1.0, timeout_s=PATIENCE_S)
        daemon.stop()
        damage(tmp_path / FILE)
        (tmp_path / FILE.parent.parent / "selftest").mkdir(exist_ok=True)
        (tmp_path / FILE.parent.parent / "selftest" / "right.json").write_bytes(b"\xff")
        daemon.start()
        daemon.wait_until_serving()  # it waits for nobody who writes into the pipe
        assert daemon.wait_for(lambda contact: contact.pad == "right" and contact.health == "ok")
        sick = daemon.wait_for(lambda contact: contact.pad == "left")
        assert sick.health == "no_baseline"
        assert "left.json" in sick.reason
        if damage is not folder:  # the one who puts a folder there removes it
            daemon.request("baseline", pad="left", rest=True, duration_s=1.0, timeout_s=PATIENCE_S)
            assert daemon.wait_for(lambda contact: contact.pad == "left" and contact.health == "ok")
