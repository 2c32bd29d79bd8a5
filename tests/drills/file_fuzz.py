"""Damages files of every kind at random, and demands that each reader fails with its own named error only.

    python tests/drills/file_fuzz.py --inputs 1000000

Half of the damages affect the bytes: bits flipped, bytes replaced, cut, doubled, inserted. The others affect the
contents (file_damage.py): any value of a document becomes another one or is repeated, a container is rewritten with
correct checksums and a false length, and the hash of a baseline is recomputed. No damaged file is accepted by chance:
of the damages to bytes, a file with a hash must let none in that changes a number.

Each input may take a second of the processor and the process 200 MB. An input that breaks a rule is kept, and named in
the log. Each processor has a worker; the seed and the number of an input reproduce it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from drills.file_damage import damaged
from drills.file_kinds import Kind, kinds

LONGEST_S, LARGEST_MB = 1.0, 200.0
HANGS_S = 60  # after this time an input is interrupted
SHARD = 2000  # inputs that a worker tries before it reports
PEAK, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass
class Tried:
    """said: how often a reader refused or read. longest_s, largest_mb: of an input; all memory of its process."""

    kind: str
    said: Counter[str] = field(default_factory=Counter)
    longest_s: float = 0.0
    largest_mb: float = 0.0
    broken: str = ""

    def add(self, other: Tried) -> None:
        self.said += other.said
        self.longest_s = max(self.longest_s, other.longest_s)
        self.largest_mb = max(self.largest_mb, other.largest_mb)
        self.broken = self.broken or other.broken

    def __str__(self) -> str:
        inputs = sum(self.said.values())
        return (
            f"{self.kind}: {inputs} inputs, {self.said['refused']} refused, {self.said['read']} read, at most "
            f"{self.longest_s:.2f} s and {self.largest_mb:.0f} MB{', ' if self.broken else ''}{self.broken}"
        )


def spoilt(kind: Kind, number: int, seed: int) -> tuple[bytes, bool]:
    """The input of this number, and whether its contents were rewritten instead of its bytes damaged."""
    dice = Random(f"{kind.name} {seed} {number}")
    if kind.remade is not None and number % 2 == 1:
        return kind.remade(dice), True
    return damaged(kind.whole, dice), False


def fuzzed(kind: Kind, folder: Path, numbers: Sequence[int], seed: int, limits: bool = False) -> Tried:
    """The reader's answers to these inputs. AssertionError with the damage that was accepted.

    limits: also measure time and memory, and compare them with LONGEST_S and LARGEST_MB.
    """
    tried = Tried(kind.name)
    path = folder / "damaged"
    path.write_bytes(kind.whole)
    right = kind.read(path)
    for number in numbers:
        content, was_remade = spoilt(kind, number, seed)
        path.write_bytes(content)
        del content  # so that its memory does not count
        begun_s = time.process_time()
        if limits:
            RESET.write_text("5")
        try:
            answer = _read(kind, path)
        except kind.error:
            tried.said["refused"] += 1
        except Exception as error:
            raise AssertionError(f"{_kept(kind, number, path)}: {type(error).__name__}: {error}") from error
        else:
            tried.said["read"] += 1
            if kind.hashed and not was_remade:
                assert answer == right, f"{_kept(kind, number, path)}: believed, and says something else"
        if limits:
            took_s, peak_mb = time.process_time() - begun_s, _peak_mb()
            tried.longest_s, tried.largest_mb = max(tried.longest_s, took_s), max(tried.largest_mb, peak_mb)
            if took_s > LONGEST_S or peak_mb > LARGEST_MB:
                tried.broken = f"{_kept(kind, number, path)}: {took_s:.2f} s, {peak_mb:.0f} MB"
    return tried


def _read(kind: Kind, path: Path) -> object:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # arithmetic beyond any pad's numbers
        signal.alarm(HANGS_S)
        try:
            return kind.read(path)
        finally:
            signal.alarm(0)


def _kept(kind: Kind, number: int, path: Path) -> str:
    kept = Path(tempfile.gettempdir()) / f"fooled-{kind.name.replace(' ', '-')}-{number}"
    shutil.copy(path, kept)
    return f"{kind.name}, input {number}, kept as {kept}"


def _peak_mb() -> float:
    (line,) = (line for line in PEAK.read_text().splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 1e3


def _hung(*_: object) -> None:
    raise TimeoutError(f"it took longer than {HANGS_S} s")


def _shard(name: str, first: int, end: int, seed: int) -> Tried:
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_STATE_HOME"] = folder
        signal.signal(signal.SIGALRM, _hung)
        (kind,) = (kind for kind in kinds(Path(folder)) if kind.name == name)
        try:
            return fuzzed(kind, Path(folder), range(first, end), seed, limits=True)
        except AssertionError as broken:
            return Tried(name, broken=str(broken))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=1_000_000, help="in all: more of the kinds that are read soon")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("kinds", nargs="*", help="only these kinds")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_STATE_HOME"] = folder
        chosen = [kind for kind in kinds(Path(folder)) if not options.kinds or kind.name in options.kinds]
    share = options.inputs / sum(kind.cost**-0.5 for kind in chosen)
    tried = {kind.name: Tried(kind.name) for kind in chosen}
    begun_s = time.monotonic()
    with ProcessPoolExecutor(options.workers, max_tasks_per_child=1) as pool:
        shards = []
        for kind in chosen:
            inputs = round(share * kind.cost**-0.5)
            for first in range(0, inputs, SHARD):
                shards.append((kind.name, first, min(first + SHARD, inputs), options.seed))
        Random(options.seed).shuffle(shards)  # so that an hour covers all kinds
        for number, done in enumerate(as_completed([pool.submit(_shard, *shard) for shard in shards]), 1):
            one = done.result()
            tried[one.kind].add(one)
            print(f"{number}/{len(shards)}, {time.monotonic() - begun_s:.0f} s: {tried[one.kind]}", flush=True)
    print("\n".join(map(str, tried.values())))
    if any(one.broken for one in tried.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
