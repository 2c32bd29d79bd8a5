"""How Rerun, Foxglove and the MCAP project read a recording: `make viewers`.

Records a simulated pad; Rerun's own reader, `mcap-ros2-support` (of PyPI) and Foxglove's own parsers (of npm) read its
ROS 2 messages. Each must find the numbers of the recording's own messages, without a plug-in.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

ROOT = Path(__file__).parents[3]
HERE = Path(__file__).parent
sys.path.insert(0, str(ROOT / "tests"))

from drills.versions import uv  # noqa: E402
from end_to_end.processes import RunningDaemon  # noqa: E402
from fmfts_recording.ros2 import NUMBERS  # noqa: E402

PAD = """[[pad]]
name = "left"
[pad.source]
type = "simulated"
[pad.placement]
position_mm = [10, -20, 30]
rotation_deg = [0, 90, 0]
"""
PYTHON = ("rerun-sdk>=0.41", "mcap-ros2-support>=0.6", "pandas")
NPM = ("@mcap/core@2.2.2", "@mcap/nodejs@1.0.2", "@mcap/support@1.1.0", "@foxglove/rosmsg@5.0.5")
NPM += ("@foxglove/rosmsg2-serialization@3.1.0",)


def own_contacts(recording: Path) -> dict[int, dict[str, Any]]:
    """Keyed by the time of their sample (UTC); an absent key means unknown."""
    with recording.open("rb") as file:
        bodies = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages(["contact/left"])]
    return {body["utc_ns"] - (body["t_publish_ns"] - body["t_sample_ns"]): body for body in bodies}


def read_by(name: str, words: list[str | Path]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Topic and message of each line that the program prints."""
    ended = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise SystemExit(f"{name}: {ended.stderr[-2000:]}")
    for line in ended.stdout.splitlines():
        read = json.loads(line)
        yield read["topic"].strip("/"), read["told"]


def compare(name: str, messages: Iterator[tuple[str, dict[str, Any]]], contacts: dict[int, dict[str, Any]]) -> None:
    counts = {"ros/left/contact": 0, "ros/left/wrench": 0, "tf": 0}
    numbers = 0
    for topic, told in messages:
        counts[topic] += 1
        if topic == "tf":
            (placed,) = told.get("transforms", (told,))
            assert (placed["header"]["frame_id"], placed["child_frame_id"]) == ("fmfts", "left")
            place = [round(placed["transform"]["translation"][axis], 7) for axis in "xyz"]  # Rerun draws with 32 bits
            assert place == [0.01, -0.02, 0.03]
            continue
        stamp, force = told["header"]["stamp"], told["wrench"]["force"]
        own = contacts[stamp["sec"] * 1_000_000_000 + stamp["nanosec"]]
        # A busy computer makes a pad stale now and then: then there is no force, and no wrench message.
        is_known = "force_n" in own
        assert force["z"] == -own["force_n"] if is_known else math.isnan(force["z"])
        if topic == "ros/left/contact":
            assert (told["health"], told["contact"]) == (own["health"], int(own.get("contact", -1)))
            for key in NUMBERS:
                assert told[key] == own[key] if key in own else math.isnan(told[key]), f"{key}: {told[key]}"
            variance = told["wrench_covariance"][14]
            assert variance == own["force_sd_n"] * own["force_sd_n"] if is_known else math.isnan(variance)
            numbers += len(NUMBERS)
    assert counts["ros/left/contact"] == len(contacts), f"{counts} of {len(contacts)}"
    assert counts["ros/left/wrench"] == sum("force_n" in body for body in contacts.values()) > 0, counts
    assert counts["tf"] > 1
    print(f"{name}: {len(contacts)} contacts and wrenches, {counts['tf']} transforms; {numbers} numbers to the bit")


def recorded(folder: Path, seconds: float) -> Path:
    recording = folder / "touch.mcap"
    with RunningDaemon(folder, PAD) as daemon:
        command = [sys.executable, "-m", "fmfts", "record", recording, "--ros2", "--seconds", str(seconds)]
        subprocess.run(command, env=os.environ | {"FMFTS_BUS": daemon.base}, check=True, stdout=subprocess.DEVNULL)
    return recording


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--environment", type=Path, default=ROOT / "build/viewers", help="kept for the next time")
    options.add_argument("--seconds", type=float, default=8.0, help="of the recording")
    chosen = options.parse_args()
    place: Path = chosen.environment.resolve()
    if not (place / "bin/python").exists():
        uv("venv", place)
        uv("pip", "install", "--python", place, *PYTHON)
    if shutil.which("npm") is None:
        raise SystemExit("npm is not there, which brings Foxglove's parsers; run: sudo apt-get install nodejs npm")
    subprocess.run(["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", place, *NPM], check=True)
    with tempfile.TemporaryDirectory() as folder:
        recording = recorded(Path(folder), chosen.seconds)
        contacts = own_contacts(recording)
        assert any(body["contact"] for body in contacts.values()), "the scripted finger comes"
        script = shutil.copy(HERE / "foxglove.mjs", place)  # node looks for packages beside the script
        for name, words in {
            "Rerun": [place / "bin/python", HERE / "by_rerun.py", recording],
            "mcap-ros2-support": [place / "bin/python", HERE / "by_mcap.py", recording],
            "Foxglove": ["node", script, recording],
        }.items():
            compare(name, read_by(name, words), contacts)


if __name__ == "__main__":
    main()
