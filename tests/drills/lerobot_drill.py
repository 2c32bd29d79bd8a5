"""Makes an environment with LeRobot, starts a daemon on a simulated pad, and runs lerobot_data_set.py there."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from drills.versions import uv  # noqa: E402
from emulator.priority import put_ahead  # noqa: E402
from end_to_end.processes import RunningDaemon  # noqa: E402

PAD = '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\n'


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--environment", type=Path, default=ROOT / "build/lerobot", help="kept for the next time")
    options.add_argument("--seconds", type=float, default=60.0, help="of the data set")
    chosen = options.parse_args()
    place: Path = chosen.environment.resolve()
    if not place.exists():
        uv("venv", "--python", "3.12", place)
        uv("pip", "install", "--python", place, "lerobot[dataset]>=0.6")
    sources = place / "sources"
    shutil.rmtree(sources, ignore_errors=True)
    for name in ("python", "lerobot"):  # setuptools builds beside its sources, so a copy
        shutil.copytree(ROOT / "clients" / name, sources / name, ignore=shutil.ignore_patterns("build", "*.egg-info"))
    anew = ("--reinstall-package", "fmfts-client", "--reinstall-package", "lerobot_camera_fmfts")
    uv("pip", "install", "--python", place, *anew, sources / "python", sources / "lerobot")
    with tempfile.TemporaryDirectory() as folder, RunningDaemon(Path(folder), PAD) as daemon:
        script = Path(__file__).with_name("lerobot_data_set.py")
        words = [place / "bin/python", script, "--seconds", str(chosen.seconds), "--daemon", str(daemon.process.pid)]
        environment = os.environ | {"FMFTS_BUS": daemon.base, "HF_HOME": folder, "HF_HUB_OFFLINE": "1"}
        for task in Path(f"/proc/{daemon.process.pid}/task").iterdir():
            put_ahead(int(task.name))  # the test is about reading, and not about the load of this computer
        print(
            f"a data set of {chosen.seconds:g} s; what LeRobot says of FFmpeg does not matter: no video is decoded",
            flush=True,
        )
        reading = subprocess.Popen(list(map(str, words)), env=environment)
        put_ahead(reading.pid)
        return reading.wait()


if __name__ == "__main__":
    sys.exit(main())
