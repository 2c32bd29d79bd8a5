"""Drills on the computer's side: a wedged bus, a write that is cut off, a deaf subscriber, a clock that is set back."""

from __future__ import annotations

import hashlib
import os
import random
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import zmq

from drills.rig import PATIENCE_S, Ear, longest_gap_s, none_wrong, resident_kb
from end_to_end.kernel_bus import KernelBus, kernel_bus
from end_to_end.processes import RunningDaemon
from fmfts.config import SimulatedSource
from fmfts_client import Contact, Subscription

Facts = dict[str, Any]
# A stopped process is as cut off as a dead one, and no interpreter must be started for each cut.
LOOKS = 20
C_COMPILER = ("gcc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O2")
SIMULATED = """
[[pad]]
name = "{name}"
[pad.source]
type = "simulated"
finger = "none"
"""
I2C = """
[[pad]]
name = "{name}"
[pad.source]
type = "i2c"
bus = {bus}
rate_hz = 75
"""
STORE_FOR_EVER = """
import hashlib
from fmfts import baseline as baselines
from fmfts.config import PadConfig, SimulatedSource
from fmfts.baseline.files import store
from fmfts_simulation.baseline import simulated_baseline
config = PadConfig(name="left", source=SimulatedSource(rate_hz=75))
pad, baseline = config.pad(), simulated_baseline(config)
store(baseline, pad)
print(hashlib.sha256(baselines.encode(baseline)).hexdigest(), flush=True)
while True:
    store(baseline, pad)
"""


def touched(contact: Contact) -> str:
    """A simulated pad is mounted with errors that only its baseline knows: from outside, its touch can be judged."""
    return f"touched, and nothing touches it: {contact}" if contact.contact else ""


def listening(daemon: RunningDaemon, pad: str) -> Subscription:
    return Subscription(("contact",), pad, daemon.base)


def wedged_bus(folder: Path, seconds: float) -> Facts:
    """One pad's bus hangs in a system call; a pad on another bus and one on none must not notice. Needs umockdev."""
    pads = I2C.format(name="left", bus=7) + I2C.format(name="middle", bus=8) + SIMULATED.format(name="right")
    with kernel_bus() as bus:
        try:
            with RunningDaemon(folder, pads) as daemon:
                return _wedge(daemon, bus, seconds)
        finally:
            bus.order(block_s=0)


def _wedge(daemon: RunningDaemon, bus: KernelBus, seconds: float) -> Facts:
    with listening(daemon, "left") as messages, others(daemon, ("middle", "right")) as undisturbed:
        left = Ear(messages, touched)
        left.until(lambda contact: contact.sensors_ok == 0b1111)
        before = undisturbed(seconds)
        bus.order(block_s=3600)
        during = undisturbed(seconds)
        bus.order(block_s=0)
        start = time.monotonic()
        said = set()
        while (contact := left.next()).sensors_ok != 0b1111 or contact.t_publish_ns < start * 1e9:
            said.add(contact.health)
            assert time.monotonic() - start < PATIENCE_S, contact
        recovered_s = time.monotonic() - start
        none_wrong(left)
    facts = {
        "seconds": seconds,
        "recovered_s": round(recovered_s, 3),
        "said_of_the_wedged": sorted(said),
        "others": {pad: {"before": before[pad], "during": during[pad]} for pad in during},
        "other_health": sum(stretch["other_health"] for stretch in during.values()),
        "least_share_of_rate": round(min(during[pad]["rate_hz"] / before[pad]["rate_hz"] for pad in during), 3),
    }
    assert all(stretch[fault] == 0 for stretch in during.values() for fault in ("lost", "other_health")), facts
    # A pad that waited for the bus would be silent for as long as it hangs.
    assert all(stretch["longest_gap_s"] < 0.8 * seconds for stretch in during.values()), facts
    assert "stale" in said or "disconnected" in said, facts
    return facts


@contextmanager
def others(daemon: RunningDaemon, pads: Sequence[str]) -> Iterator[Callable[[float], dict[str, Facts]]]:
    """What each of `pads` published in the next seconds, by the times and numbers in its own messages."""
    with ExitStack() as stack:
        ears = {pad: Ear(stack.enter_context(listening(daemon, pad)), touched) for pad in pads}
        health = {"middle": "no_baseline", "right": "ok"}
        for pad, ear in ears.items():
            ear.until(lambda contact, pad=pad: contact.health == health[pad] and contact.sensors_ok == 0b1111)

        def heard(seconds: float) -> dict[str, Facts]:
            begin_ns = time.monotonic_ns()
            end_ns = begin_ns + int(seconds * 1e9)
            return {pad: _stretch(ear, begin_ns, end_ns, health[pad]) for pad, ear in ears.items()}

        yield heard
        for ear in ears.values():
            none_wrong(ear)


def _stretch(ear: Ear, begin_ns: int, end_ns: int, health: str) -> Facts:
    contacts = []
    while (contact := ear.next()).t_publish_ns < end_ns:
        if contact.t_publish_ns >= begin_ns:
            contacts.append(contact)
    gaps_s = [(b.t_publish_ns - a.t_publish_ns) * 1e-9 for a, b in pairwise(contacts)]
    return {
        "rate_hz": round(len(gaps_s) / sum(gaps_s), 1),
        "longest_gap_s": round(max(gaps_s), 3),
        "lost": sum(b.seq - a.seq - 1 for a, b in pairwise(contacts)),
        "other_health": sum(contact.health != health for contact in contacts),
    }


def killed_in_a_write(folder: Path, times: int) -> Facts:
    """SIGKILL while a baseline is being stored, again and again: the file is the old one or the new one, never half."""
    chance = random.Random(3)
    environment = os.environ | {"STATE_DIRECTORY": str(folder)}
    file = folder / "baseline" / "left.json"
    stored, seen = set(), set()
    for _ in range(times):
        process = subprocess.Popen([sys.executable, "-c", STORE_FOR_EVER], stdout=subprocess.PIPE, env=environment)
        assert process.stdout is not None
        stored.add(process.stdout.readline().decode().strip())
        for _ in range(LOOKS):
            time.sleep(chance.uniform(0.0, 0.01))
            process.send_signal(signal.SIGSTOP)
            seen.add(hashlib.sha256(file.read_bytes()).hexdigest())
            process.send_signal(signal.SIGCONT)
        time.sleep(chance.uniform(0.0, 0.01))
        process.kill()
        process.communicate()
        seen.add(hashlib.sha256(file.read_bytes()).hexdigest())
    unfinished = len(list(file.parent.glob(".*.tmp")))
    facts = {"kills": times, "looks": (LOOKS + 1) * times, "half_files": len(seen - stored), "left_over": unfinished}
    assert seen == stored, facts
    return facts


def deaf_subscriber(folder: Path, seconds: float) -> Facts:
    """A subscriber to everything that never reads, beside one that does."""
    pads = "".join(SIMULATED.format(name=f"p{i}") for i in range(2))
    with RunningDaemon(folder, pads) as daemon, listening(daemon, "p0") as messages:
        ear = Ear(messages, touched)
        ear.listen(1.0)
        before = resident_kb(daemon.process.pid)
        with zmq.Context() as context, context.socket(zmq.SUB) as deaf:
            deaf.setsockopt(zmq.LINGER, 0)
            deaf.setsockopt(zmq.RCVHWM, 1)
            deaf.setsockopt(zmq.RCVBUF, 4096)
            deaf.setsockopt(zmq.SUBSCRIBE, b"")
            deaf.connect(f"{daemon.base}/bus")
            heard = ear.listen(seconds)
            grown = resident_kb(daemon.process.pid) - before
    missing = heard[-1].seq - heard[0].seq + 1 - len(heard)
    facts = {"seconds": seconds, "memory_grown_kb": grown, "lost_by_the_other": missing,
             "longest_gap_s": longest_gap_s(heard)}  # fmt: skip
    assert missing == 0, facts
    assert grown < 20_000, facts  # 256 messages of 600 bytes for each subscriber, and what the kernel holds
    return facts | none_wrong(ear)


class WallClock:
    """A wall clock of child processes that is shifted by the seconds set last. Needs a C compiler."""

    def __init__(self, folder: Path) -> None:
        self.library, self.file = folder / "wall_clock.so", folder / "wall_clock"
        build = (*C_COMPILER, "-shared", "-fPIC", "-o", self.library, Path(__file__).with_name("wall_clock.c"))
        subprocess.run(build, check=True)
        self.file.write_bytes(bytes(8))

    def set(self, offset_s: int) -> None:
        with self.file.open("r+b") as file:  # in place, because the processes with this clock have mapped it
            file.write(struct.pack("=q", offset_s))


@contextmanager
def settable_clock(folder: Path) -> Iterator[WallClock]:
    clock = WallClock(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LD_PRELOAD", str(clock.library))
        patch.setenv("WALL_CLOCK", str(clock.file))
        yield clock


def clock_set_back(folder: Path, seconds: float) -> Facts:
    """The wall clock jumps back an hour under the running daemon, and then forward by two."""
    config = SIMULATED.format(name="left")
    with settable_clock(folder) as clock, RunningDaemon(folder, config) as daemon, daemon.subscribe() as messages:
        ear = Ear(messages, touched)
        heard = ear.listen(seconds)
        clock.set(-3600)
        heard += ear.listen(seconds)
        clock.set(3600)
        heard += ear.listen(seconds)
    offsets = [contact.utc_ns - contact.t_publish_ns for contact in heard]
    jumps = [round((b - a) * 1e-9) for a, b in pairwise(offsets) if abs(b - a) > 1e9]
    lasted_s = (heard[-1].t_publish_ns - heard[0].t_publish_ns) * 1e-9
    facts = {"jumps_of_utc_s": jumps, "messages": len(heard), "longest_gap_s": longest_gap_s(heard),
             "share_of_rate": round((len(heard) - 1) / lasted_s / SimulatedSource().rate_hz, 3),
             "not_ok": sum(contact.health != "ok" for contact in heard)}  # fmt: skip
    assert jumps == [-3600, 7200], facts  # false: the clock was never set
    assert all(b.seq == a.seq + 1 and b.t_sample_ns > a.t_sample_ns for a, b in pairwise(heard)), facts
    assert facts["not_ok"] == 0, facts
    # A busy computer costs frames; a simulated pad that only the tick wakes would have a third of them.
    assert 0.5 < facts["share_of_rate"] < 1.05, facts
    return facts | none_wrong(ear)
