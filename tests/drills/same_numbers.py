"""Recordings replayed as on other processors: every SHA-256 of all messages must be the same (`make same-numbers`).

The shipped recordings, and one of two pads that is made here. OpenBLAS, NumPy and glibc choose their code by the
processor; each can be told to choose as on another one, if this one has its instructions. aarch64 runs under qemu-user,
from the cross-built wheel (`--aarch64`, some minutes). "others differ": these libraries themselves computed other
numbers than here.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from aarch64 import debian, emulated, install, wheel

from fmfts_recording.replay import Replay

ROOT = Path(__file__).parents[2]
SHIPPED = sorted((ROOT / "tests/data/recordings").glob("*.mcap"))
STARTED_WITHIN_S = 60.0
CORES = ("Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX")
PLAIN_GLIBC = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX"}
# Another NumPy names its variants differently.
_numpy = getattr(np, "_core", None) or np.core
PLAIN_NUMPY = {"NPY_DISABLE_CPU_FEATURES": " ".join(_numpy._multiarray_umath.__cpu_dispatch__)}
PROCESSORS: dict[str, dict[str, str]] = {
    "this one": {},
    **{f"OpenBLAS as on {core}": {"OPENBLAS_CORETYPE": core} for core in CORES},
    "glibc without AVX2, FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
    "all three as in 2004": {"OPENBLAS_CORETYPE": "Prescott"} | PLAIN_GLIBC | PLAIN_NUMPY,
}
REPLAY = """
import hashlib, math, sys
from pathlib import Path
import numpy as np
from fmfts_recording.replay import Replay
# What those libraries make of the same numbers: where that is another than here, the setting did something.
random = np.random.default_rng(0)
a, x = random.normal(size=(50, 50)), random.normal(size=1000)
print(hashlib.sha256(b"".join((a @ a, np.exp(x), np.array([math.exp(each) for each in x.tolist()])))).hexdigest())
for path in sys.argv[1:]:
    replay = Replay(Path(path))
    count = sum(1 for _ in replay.contacts())
    print(replay.facts()["sha256"], replay.comparison.is_the_same, count)
"""


def two_pads() -> str:
    """The standard pad, and array.toml's with two of its magnets: it has no table, so its poses are solved."""
    array = (ROOT / "daemon/fmfts/config/array.toml").read_text()
    head, *magnets = re.split(r"(?m)^(?=\[\[pad\.magnet\]\])", array)
    if len(magnets) != 4 or "\n[pad." in "".join(magnets):
        raise SystemExit("array.toml no longer ends with four [[pad.magnet]] tables: choose anew in two_pads()")
    return '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\n' + head + "".join(magnets[:2])


def made_on_the_spot(path: Path, seconds: float) -> Path:
    """A scripted finger on each of two pads, through a daemon and `record`."""
    daemon = [sys.executable, "-m", "fmfts"]
    environment = os.environ | {
        "FMFTS_BUS": f"ipc://{path.parent}/bus",
        "XDG_STATE_HOME": str(path.parent),
        "XDG_RUNTIME_DIR": str(path.parent),
    }
    config = path.with_suffix(".toml")
    config.write_text(two_pads())
    with subprocess.Popen([*daemon, "run", "--config", config], env=environment, stderr=subprocess.PIPE) as serving:
        try:
            record = [*daemon, "record", path, "--seconds", str(seconds)]
            until = time.monotonic() + STARTED_WITHIN_S
            while (ended := subprocess.run(record, env=environment, check=False, capture_output=True)).returncode:
                if serving.poll() is not None:
                    raise SystemExit(f"the daemon ended with {serving.returncode}: {serving.communicate()[1].decode()}")
                if time.monotonic() > until:
                    raise SystemExit(f"nothing could be recorded: {ended.stderr.decode()}")
                path.unlink(missing_ok=True)
        finally:
            serving.terminate()
    told = [each for each in Replay(path).contacts() if each.health == "ok"]
    for what, count in (
        ("a force of pad left", sum(each.pad == "left" and each.force_n is not None for each in told)),
        ("poses of pad array", sum(each.pad == "array" and bool(each.poses) for each in told)),
    ):
        if count == 0:
            raise SystemExit(f"what was recorded on the spot has no good message with {what}: it would prove nothing")
        print(f"recorded on the spot: {count} messages with {what}", flush=True)
    return path


@dataclass(frozen=True)
class Replays:
    """Results of one processor. others: the libraries' numbers; one: of each recording SHA-256, same as recorded,
    messages."""

    others: str
    each: list[tuple[str, bool, int]]


def replayed(python: list[str | Path], paths: list[Path], environment: dict[str, str]) -> Replays:
    command = [*python, "-W", "ignore", "-c", REPLAY, *paths]
    ended = subprocess.run(command, env=os.environ | environment, check=False, capture_output=True, text=True)
    if ended.returncode != 0:
        raise SystemExit(f"{environment}: {ended.stderr}")
    others, *lines = ended.stdout.splitlines()
    return Replays(others, [(digest, same == "True", int(count)) for digest, same, count in map(str.split, lines)])


def all_replays(paths: list[Path], cache: Path | None) -> Iterator[tuple[str, Replays]]:
    """cache: the folder of aarch64's Python; None excludes it."""
    for name, environment in PROCESSORS.items():
        yield name, replayed([sys.executable], paths, environment)
    if cache is not None:
        tree = debian(cache)
        install(wheel(tree, cache / "aarch64"), cache / "aarch64/site")
        yield "aarch64, under qemu", replayed(emulated(tree, cache / "aarch64/site"), paths, {})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--aarch64", action="store_true", help="also under qemu, from the cross-built wheel")
    parser.add_argument("--seconds", type=float, default=5.0, help="of the recording that is made on the spot")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        paths = [*SHIPPED, made_on_the_spot(Path(folder) / "made_now.mcap", options.seconds)]
        here: Replays | None = None
        wrong = 0
        for name, replays in all_replays(paths, (ROOT / "build").resolve() if options.aarch64 else None):
            here = here or replays
            changes = (
                "this computer"
                if here is replays
                else "others differ"
                if here.others != replays.others
                else "no effect"
            )
            for path, (first, _, _), (digest, same, count) in zip(paths, here.each, replays.each, strict=True):
                good = same and digest == first
                wrong += not good
                verdict = "identical" if good else "DIFFERS"
                print(f"{name:26} {changes:13} {path.stem:9} {count:5} messages {verdict:9} {digest}", flush=True)
    print(f"{wrong} of all these replays differ" if wrong else "every replay is identical, to the last bit")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
