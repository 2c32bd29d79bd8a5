"""The pad with one magnet beside another build: the same messages, in the same time? `bench frame --beside COMMIT`.

COMMIT is built in a temporary folder; in its place may stand a folder that holds the other build's packages (wheels
that were unpacked): no module of theirs may then be loaded from elsewhere. Each build runs in a process of its own with
the same frames, and they take turns, so that other work of the computer delays both alike.
"""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

TURNS = 150
REPOSITORY = Path(__file__).parents[3]
# From a frame to its encoded message. It prints the file of each module that it loaded from the build. Then it waits
# for a line, takes a turn of 100 frames, and prints its processor time and, in base64, the messages.
WORKER = """
import base64, json, sys, time
import msgspec
from fmfts.bus.encoding import encode
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.source import Simulated
config = PadConfig(name="bench", source=SimulatedSource(seed=1))
pipeline = pipeline_of(config, contact_model_of(config), "bench")
pipeline.use(simulated_baseline(config))
source, step = Simulated(config), 0
files = {name: getattr(module, "__file__", None) for name, module in sys.modules.items() if name.startswith("fmfts")}
print(json.dumps({name: file for name, file in files.items() if file}), flush=True)
for _ in sys.stdin:
    frames, told = [], []
    while len(frames) < 100:
        frames.extend(source.poll(round(step * 1e9 / 220)))
        step += 1
    begun = time.process_time_ns()
    for frame in frames:
        told.append(encode(pipeline.process(frame)))
    taken = time.process_time_ns() - begun
    print(taken, base64.b64encode(msgspec.msgpack.encode(told)).decode(), flush=True)
"""
OF_A_RUN = ("t_publish_ns", "utc_ns", "baseline")  # the baseline's identity holds the time of its recording


@dataclass
class Compared:
    """Messages of two builds, without the fields that differ in each run. fields: the differing fields, with the number
    of messages.
    """

    messages: int = 0
    same: int = 0
    fields: Counter[str] = field(default_factory=Counter)
    largest: dict[str, float] = field(default_factory=dict)

    def add(self, one: bytes, other: bytes) -> None:
        """The encoded messages of one frame."""
        mine, theirs = (msgspec.msgpack.decode(each) for each in (one, other))
        for name in OF_A_RUN:
            del mine[name], theirs[name]
        differing = dict(_differing(mine, theirs))
        self.messages += 1
        self.same += not differing
        self.fields.update(differing.keys())
        for name, share in differing.items():
            if np.isfinite(share):
                self.largest[name] = max(self.largest.get(name, 0.0), share)

    def __str__(self) -> str:
        told = f"{self.same} of {self.messages} messages the same to the last bit"
        each = (
            f"\n  {name} differs in {count}"
            + (f", by {self.largest[name]:.2g} of it at most" if name in self.largest else "")
            for name, count in self.fields.most_common()
        )
        return told + "".join(each)


def _differing(one: Any, other: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """The names of the fields whose bits differ, and by which share of the larger one; infinite: not by a number."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in one | other:
            yield from _differing(one.get(key), other.get(key), f"{name}.{key}" if name else key)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        parts = [share for pair in zip(one, other, strict=True) for _, share in _differing(*pair)]
        if parts:
            yield name, max(parts)
    elif msgspec.msgpack.encode(one) != msgspec.msgpack.encode(other):
        are_numbers = all(isinstance(each, float | int) for each in (one, other))
        yield name, abs(one - other) / max(abs(one), abs(other)) if are_numbers else np.inf


def run(other: str) -> None:
    """Print whether the messages are the same, and the ratio of this build's time to the other's. SystemExit where
    `other` is no folder with a package and no commit."""
    with ExitStack() as stack:
        folder = Path(other)
        if not folder.is_dir():
            folder = _built(other, Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fmfts-beside-"))))
        if not (folder / "fmfts/__init__.py").is_file():
            raise SystemExit(
                f"{other}: holds no package fmfts; unpack a wheel of the other build there, or name a commit"
            )
        both = [stack.enter_context(_worker(path)) for path in (None, folder)]
        ours, theirs = (json.loads(_line(worker)) for worker in both)
        for name, file in _from_elsewhere(theirs, folder, ours):
            raise SystemExit(
                f"{other}: nothing was compared, because the other process loaded {name} from {file}; name a folder "
                "that holds all of the other build, or a commit"
            )
        taken, compared = np.empty((TURNS, 2)), Compared()
        for turn in range(TURNS):
            told: list[list[bytes]] = [[], []]
            for which in (turn % 2, 1 - turn % 2):
                print(file=both[which].stdin, flush=True)
                time_ns, messages = _line(both[which]).split()
                taken[turn, which] = float(time_ns)
                told[which] = msgspec.msgpack.decode(base64.b64decode(messages), type=list[bytes])
            for pair in zip(*told, strict=True):
                compared.add(*pair)
        for worker in both:
            assert worker.stdin is not None
            worker.stdin.close()
    fastest = taken.min(axis=0)
    print(compared)
    print(
        f"frame to message, this build beside the other: {fastest[0] / fastest[1]:.3f} of its time (fastest turns), "
        f"{np.median(taken[:, 0] / taken[:, 1]):.3f} (median of {TURNS} pairs); {fastest[0] * 1e-5:.1f} µs a frame"
    )


def _from_elsewhere(theirs: dict[str, str], folder: Path, ours: dict[str, str]) -> Iterator[tuple[str, Path]]:
    """Modules, with their files, that should come from `folder` but come from elsewhere, or through links from this
    build.
    """
    of_ours = {Path(file).resolve() for file in ours.values()}
    for name, file in theirs.items():
        package, real = folder / name.partition(".")[0], Path(file).resolve()
        if package.exists() and (real in of_ours or not Path(file).is_relative_to(folder.resolve())):
            yield name, real


def _built(commit: str, folder: Path) -> Path:
    """The packages of a commit of this repository, built as `pip install` builds them."""
    archive, packages = folder / "source.tar", folder / "packages"
    try:
        _do("git", "-C", str(REPOSITORY), "archive", "--output", str(archive), commit)
        (folder / "source").mkdir()
        _do("tar", "-x", "-f", str(archive), "-C", str(folder / "source"))
        sources = [
            str(folder / "source"),
            str(folder / "source" / "clients" / "python"),
            str(folder / "source" / "extras" / "simulation"),
        ]
        parts = [part for part in sources if (Path(part) / "pyproject.toml").is_file()]
        _do(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(packages), *parts)
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"{commit}: neither a folder nor a commit that can be built:\n{error.stderr}") from None
    return packages


def _do(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True)


def _worker(other: Path | None) -> subprocess.Popen[str]:
    environment = os.environ | ({} if other is None else {"PYTHONPATH": str(other.resolve())})
    command = [sys.executable, "-W", "ignore", "-c", WORKER]
    return subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def _line(worker: subprocess.Popen[str]) -> str:
    assert worker.stdout is not None
    line = worker.stdout.readline()
    if not line:
        raise SystemExit(f"a build ended with {worker.wait()}")
    return line.strip()
