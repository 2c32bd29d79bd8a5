"""Makes tests/data/reports/qmc5883l-emulated.mcap: `make kept-report`. It needs umockdev.

    python tests/data/make_report.py expect FILE.mcap

writes what a test demands of FILE.mcap beside it: for the report of somebody's hardware. README.md of that folder says
who reads it first.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from end_to_end.kernel_bus import kernel_bus
from end_to_end.processes import run_command
from fmfts_recording.file import read
from fmfts_recording.replay import Replay

FOLDER = Path(__file__).parent / "reports"
KEPT = FOLDER / "qmc5883l-emulated.mcap"
SECONDS = 2
CONFIG = """\
[[pad]]
name = "left"
[pad.source]
type = "i2c"
bus = 7
chip = "qmc5883l"
rate_hz = 100
range_gauss = 2.0
"""
EMULATED_KERNEL = """\
import platform
platform.release = lambda: "emulated"
platform.version = lambda: "by umockdev"
"""


def make(path: Path) -> None:
    """A report of four QMC5883L behind a mux, on the emulated bus."""
    with tempfile.TemporaryDirectory() as folder, kernel_bus("qmc5883l"):
        config = Path(folder) / "pad.toml"
        config.write_text(CONFIG)
        # The maker's kernel does not matter: the bus is emulated.
        (Path(folder) / "sitecustomize.py").write_text(EMULATED_KERNEL)
        environment = os.environ | {
            "XDG_STATE_HOME": folder,
            "FMFTS_BUS": f"ipc://{folder}/nobody",
            "PYTHONPATH": folder,
        }
        made = run_command("report", path, "--config", config, "--seconds", str(SECONDS), environment=environment)
    assert made.returncode == 0, made


def replayed(path: Path, models: Sequence[str] = ()) -> dict[str, Any]:
    """For each pad: its frames, and the sensors that are used in more than half of its contacts, counted from 1."""
    frames = Counter(one.pad for one in read(path) if one.kind == "frame")
    contacts: Counter[str] = Counter()
    used: dict[str, Counter[int]] = {pad: Counter() for pad in frames}
    for contact in Replay(path, models).contacts():
        contacts[contact.pad] += 1
        used[contact.pad].update(
            sensor + 1 for sensor in range(contact.sensors_ok.bit_length()) if contact.sensors_ok >> sensor & 1
        )
    return {
        pad: {
            "frames": frames[pad],
            "sensors": sorted(sensor for sensor, count in used[pad].items() if 2 * count > contacts[pad]),
        }
        for pad in sorted(frames)
    }


def expect(path: Path) -> None:
    path.with_suffix(".json").write_text(json.dumps(replayed(path), indent=1) + "\n")


if __name__ == "__main__":
    if sys.argv[1:2] == ["expect"]:
        expect(Path(sys.argv[2]))
    else:
        KEPT.unlink(missing_ok=True)
        make(KEPT)
        expect(KEPT)
