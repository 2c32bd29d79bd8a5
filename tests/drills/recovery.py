"""Events in a robot's life, repeated, with the time to recovery: `make drills`, and smaller in `make test`.

Every drill returns its facts, and asserts that no wrong number was published meanwhile.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from drills import anyskin_drills
from drills.beside import probed
from drills.control_fuzz import fuzzed_control
from drills.daemon_drills import clock_set_back, deaf_subscriber, killed_in_a_write, wedged_bus
from drills.rig import (
    PATIENCE_S,
    calibrated,
    descriptors,
    is_not_ok,
    is_ok,
    none_wrong,
    resident_kb,
    send_garbage,
    summary,
)

Facts = dict[str, Any]
# Judged by `make drills` alone, because other programs of a computer delay frames and recoveries, too.
HELD: dict[str, Callable[[Facts], bool]] = {
    "replug": lambda facts: facts["longest_s"] <= 1.0,
    "reset": lambda facts: facts["longest_s"] <= 1.0,
    "garbage": lambda facts: facts["recovered_s"] <= 0.5,
    # The firmware asks an absent sensor every 0.8 s.
    "nack": lambda facts: facts["recovered_s"] <= 1.5,
    # A reader that is stuck is ended after 2 s, the next one starts within another, and its filters begin anew.
    "wedge": lambda facts: facts["recovered_s"] <= 5.0 and facts["least_share_of_rate"] >= 0.95,
    "clock": lambda facts: facts["longest_gap_s"] <= 0.5 and facts["share_of_rate"] >= 0.95,
    "deaf": lambda facts: facts["longest_gap_s"] <= 0.5,
    "probe": lambda facts: not facts["not_ok"] and facts["longest_gap_s"] <= 0.5,
    # The period of an AnySkin stream is measured for half a second before anything is published.
    "skin-replug": lambda facts: facts["longest_s"] <= 1.5,
    "skin-damage": lambda facts: facts["longest_s"] <= 0.5,
    "skin-baud": lambda facts: facts["longest_s"] <= 1.0,
}
BURST_BYTES = 1000
BACK_S = 0.3  # between two pulls: numbers are judged, and the finger moves


def replug(folder: Path, cycles: int) -> Facts:
    """The plug is pulled for between 0 and 1.2 s, and each time the board comes back as another pty.

    Every third time the name meanwhile belongs to another, silent device, because a port's number may be reused.
    """
    chance = random.Random(1)
    with calibrated(folder) as (daemon, host, ear):
        before, memory_kb = descriptors(daemon.process.pid), resident_kb(daemon.process.pid)
        recoveries = []
        for cycle in range(cycles):
            if cycle % 100 == 99:
                print(f"replug: {cycle + 1}, {summary(recoveries)}", file=sys.stderr, flush=True)
            host.kill()
            with silent_device(host.port) if cycle % 3 == 2 else nullcontext():
                ear.until(is_not_ok)
                ear.listen(chance.uniform(0.0, 1.2))
            host.plug()
            recoveries.append(ear.recovered(time.monotonic_ns()))
            ear.listen(BACK_S)
        grown_kb = resident_kb(daemon.process.pid) - memory_kb
        leaked = descriptors(daemon.process.pid) - before
    facts = {"cycles": cycles, **summary(recoveries), "descriptors_leaked": leaked, "memory_grown_kb": grown_kb}
    assert leaked == 0, facts
    return facts | none_wrong(ear, host)


@contextmanager
def silent_device(port: Path) -> Iterator[None]:
    board, other = os.openpty()
    port.symlink_to(os.ttyname(other))
    os.close(other)
    yield
    port.unlink()
    os.close(board)


def reset_in_a_frame(folder: Path, cycles: int) -> Facts:
    """The firmware restarts in the middle of a packet."""
    with calibrated(folder) as (_, host, ear):
        recoveries = []
        for _ in range(cycles):
            host.tell("truncate")
            host.tell("reset")
            heard = ear.listen(1.0)
            while not is_ok(heard[-1]):
                heard.append(ear.next())
                assert heard[-1].t_publish_ns - heard[0].t_publish_ns < PATIENCE_S * 1e9, heard[-1]
            times_ns = [contact.t_publish_ns for contact in heard if is_ok(contact)]
            recoveries.append(max(b - a for a, b in pairwise(times_ns)) * 1e-9)
    return {"cycles": cycles, **summary(recoveries)} | none_wrong(ear, host)


def garbage(folder: Path, size: int) -> Facts:
    """Random bytes between frames, in bursts."""
    with calibrated(folder) as (daemon, host, ear):
        before = daemon.request("status")["pads"][0]
        for seed in range(size // BURST_BYTES):
            send_garbage(host, BURST_BYTES, seed + 1, ear.listen)
            ear.listen(0.02)
        recovered_s = ear.recovered(time.monotonic_ns())
        ear.listen(1.2)
        after = daemon.request("status")["pads"][0]
    taken = after["garbage_bytes"] - before["garbage_bytes"]
    facts = {"bytes": size, "recovered_s": round(recovered_s, 3), "counted_as_garbage": taken,
             "frames_lost": after["gaps"] - before["gaps"], "crc_errors": after["crc_errors"]}  # fmt: skip
    # A burst also destroys the packet into which it runs, and the one whose end it swallows.
    assert facts["frames_lost"] <= 2 * size // BURST_BYTES, facts
    # Each zero in it ends a packet, which counts completely as garbage or as a wrong check sum.
    assert taken >= 0.9 * size, facts
    return facts | none_wrong(ear, host)


def nack_storm(folder: Path, seconds: float) -> Facts:
    """Sensors and the mux stop answering and answer again, at random, fifty times a second."""
    chance = random.Random(2)
    healths: dict[str, int] = {}
    with calibrated(folder) as (_, host, ear):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            state = chance.choice(("unplugged", "none"))
            sensor = chance.randrange(5)
            host.tell(f"mux 0 {state}" if sensor == 4 else f"fault 0 {sensor} {state}")
            for contact in ear.listen(0.02):
                healths[contact.health] = healths.get(contact.health, 0) + 1
        for sensor in range(4):
            host.tell(f"fault 0 {sensor} none")
        host.tell("mux 0 none")
        mended_ns = time.monotonic_ns()
        recovered_s = ear.recovered(mended_ns, lambda contact: is_ok(contact) and contact.sensors_ok == 0b1111)
        ear.listen(1.5)
    facts = {"seconds": seconds, "recovered_s": round(recovered_s, 3), "messages": healths}
    assert healths.keys() - {"ok"}, facts  # false: no fault arrived
    return facts | none_wrong(ear, host)


DRILLS: dict[str, tuple[Callable[[Path, Any], Facts], float]] = {
    "replug": (replug, 1000),
    "reset": (reset_in_a_frame, 100),
    "garbage": (garbage, 1_000_000),
    "nack": (nack_storm, 60.0),
    "wedge": (wedged_bus, 10.0),
    "write": (killed_in_a_write, 100),
    "deaf": (deaf_subscriber, 60.0),
    "clock": (clock_set_back, 10.0),
    "control": (fuzzed_control, 100_000),
    "probe": (probed, 100),
    "skin-replug": (anyskin_drills.unplugged, 100),
    "skin-damage": (anyskin_drills.damaged, 2000),
    "skin-baud": (anyskin_drills.other_baud, 24),
}


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("drills", nargs="*", default=list(DRILLS), metavar="DRILL", help=", ".join(DRILLS))
    options.add_argument("--share", type=float, default=1.0, help="of the full number of cycles, bytes or seconds")
    arguments = options.parse_args()
    missed = []
    for name in arguments.drills:
        drill, full = DRILLS[name]
        with tempfile.TemporaryDirectory(prefix="fmfts-") as folder:
            amount = type(full)(full * arguments.share)
            facts = drill(Path(folder), amount)
            print(json.dumps({name: facts}), flush=True)
            if name in HELD and not HELD[name](facts):
                missed.append(name)
    if missed:
        sys.exit(f"not as asked: {', '.join(missed)}")


if __name__ == "__main__":
    main()
