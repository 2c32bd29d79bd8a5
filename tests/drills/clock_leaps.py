"""Boards whose clock leaps, and lines that double, triple and reorder packets: how soon `ok`, and is any number wrong?

    PYTHONPATH=tests python -m drills.clock_leaps

Emulated boards on ptys and the daemon. A board's clock of 64 bits leaps by each power of two of microseconds from 2^20
to 2^62, forward and back, for one packet and for a second; the wire carries the lower 48 bits. Each contact is judged
by the frame that it was made of, which its watermark names (drills.chaos). Times are those at which the boards took
frames.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from drills.chaos.board import ChaosBoard
from drills.chaos.drill import AHEAD, CONFIG
from drills.chaos.faults import ORDERS
from drills.chaos.judge import Judge
from drills.chaos.pressed import RATE_HZ, Library
from emulator.priority import put_ahead
from end_to_end.processes import PATIENCE_S, RunningDaemon
from fmfts.baseline.origin import Origin

POWERS = range(20, 63)
OLD_US = 2**47  # start of every board's clock, so that it can leap back
SOON_NS = 300_000_000
WATCHED_NS = 1_000_000_000  # after the last wrong frame
REST_NS = 500_000_000
APART_NS = 2_000_000
ORDER_NS = 3_000_000_000
STATUS_S = 2.0
COPIES = 3  # of each packet, at most
INEXACT, LEAST_USED = (
    0.05,
    0.5,
)  # shares of the packets on their way; on a loaded computer


class Case(NamedTuple):
    power: int
    way: int
    frames: int

    def __str__(self) -> str:
        return f"2^{self.power} µs {'forward' if self.way > 0 else 'back'} for {self.frames} packets"


class Heard(Judge):
    """Also: when the frames of each pad's `ok` contacts were taken, and how often two contacts in a
    row claim one time of their sample."""

    def __init__(self, endpoint: str, boards: dict[str, ChaosBoard]) -> None:
        self.ok_times_ns: dict[str, list[int]] = {name: [] for name in boards}
        self.twice: Counter[str] = Counter()
        self._newest: dict[str, tuple[int, int]] = {}  # time of the sample as published, and of the frame
        super().__init__(endpoint, boards)

    def _judge(self, contact: dict[str, Any]) -> None:
        super()._judge(contact)
        pad = contact["pad"]
        if contact["health"] != "ok":
            return
        taken_ns = self.ok_ns[pad]
        self.ok_times_ns[pad].append(taken_ns)
        sampled_ns, before_ns = self._newest.get(pad, (0, 0))
        # A drill that waited for a processor receives frames within some µs, unlike from any board.
        is_apart = taken_ns == before_ns or abs(taken_ns - before_ns) > APART_NS
        self.twice[pad] += contact["t_sample_ns"] == sampled_ns and is_apart
        self._newest[pad] = contact["t_sample_ns"], taken_ns


class Drill:
    """pads: boards at one time, each with its own cases."""

    def __init__(self, folder: Path, pads: int, powers: range) -> None:
        library, config = Library(1), ""
        state = folder / "state" / "fmfts" / "baseline"
        state.mkdir(parents=True)
        self.boards: dict[str, ChaosBoard] = {}
        for number in range(pads):
            name, uid, port = f"p{number}", bytes([number + 1] * 12), folder / f"board{number}"
            board = self.boards[name] = ChaosBoard(port, uid, library, number)
            board.age_us = OLD_US
            (state / f"{name}.json").write_bytes(library.baseline(name, Origin("bridge", "hmc5983", uid.hex(), 0)))
            config += CONFIG.format(name=name, port=port, uid=uid.hex())
        self._daemon = RunningDaemon(folder, config, wait=False, through=AHEAD)
        self._cases: Iterator[Case] = iter([Case(*case) for case in product(powers, (1, -1), (1, RATE_HZ))])
        self._current: dict[str, Case | None] = dict.fromkeys(self.boards)
        self.slowest: dict[str, list[tuple[float, str]]] = {"after the leap": [], "during it": []}
        self.never: list[str] = []

    def run(self) -> dict[str, Any]:
        put_ahead()
        self._daemon.wait_until_serving(self._tick, answer_s=0.05)
        judge = Heard(f"{self._daemon.base}/bus", self.boards)
        try:
            self._wait_until_ok(judge)
            while self._leap(judge):
                self._tick()
            leaps = self._counted(judge)
            orders = {name: self._in_order(name, judge) for name in ORDERS}
            assert self._daemon.process.poll() is None, self._daemon.log.read_text()[-2000:]
        finally:
            judge.close()
            self._daemon.__exit__()
        slowest = {when: sorted(all_, reverse=True)[:3] for when, all_ in self.slowest.items()}
        return {"leaps": leaps | {"slowest_ms": slowest, "not_ok_within_1_s": self.never}, "orders": orders}

    def _tick(self) -> None:
        for board in self.boards.values():
            board.tick(time.monotonic_ns())
        time.sleep(1e-3)

    def _wait_until_ok(self, judge: Heard) -> None:
        until = time.monotonic() + PATIENCE_S
        while not all(judge.ok_times_ns.values()):
            assert time.monotonic() < until, judge.last
            self._tick()

    def _leap(self, judge: Heard) -> bool:
        """Begin and end leaps. False when all have ended."""
        now_ns = time.monotonic_ns()
        for name, board in self.boards.items():
            case = self._current[name]
            if case is not None:
                if board.leaping_frames or now_ns - board.leapt_ns < WATCHED_NS + REST_NS:
                    continue
                self._note(case, board.leap_began_ns, board.leapt_ns, judge.ok_times_ns[name])
            self._current[name] = case = next(self._cases, None)
            if case is not None:
                board.leap_began_ns, board.leap_us, board.leaping_frames = 0, case.way * 2**case.power, case.frames
        return any(case is not None for case in self._current.values())

    def _note(self, case: Case, begun_ns: int, leapt_ns: int, ok_ns: list[int]) -> None:
        if case.frames > 1:
            first_ns = min((at_ns for at_ns in ok_ns if begun_ns <= at_ns <= leapt_ns), default=leapt_ns)
            self.slowest["during it"].append((round((first_ns - begun_ns) * 1e-6), str(case)))
        after = min((at_ns for at_ns in ok_ns if at_ns > leapt_ns), default=0)
        if not after or after - leapt_ns > WATCHED_NS:
            self.never.append(str(case))
        else:
            self.slowest["after the leap"].append((round((after - leapt_ns) * 1e-6), str(case)))

    def _in_order(self, fault: str, judge: Heard) -> dict[str, Any]:
        """Some seconds of lines in this order, on all boards."""
        before = self._status()
        twice, wrong, false_times = judge.twice.total(), sum(judge.kinds.values()), judge.false_times
        until_ns = time.monotonic_ns() + ORDER_NS
        sent = self._sent()
        for board in self.boards.values():
            board.faults[fault] = until_ns
        while time.monotonic_ns() < until_ns + 3 * REST_NS:
            self._tick()
        after = self._status()
        return {
            **{name: count - sent[name] for name, count in self._sent().items()},
            **{name: after[name] - before[name] for name in ("frames", "dropped", "repeated", "gaps")},
            "published_twice": judge.twice.total() - twice,
            "wrong": sum(judge.kinds.values()) - wrong,
            "false_times": judge.false_times - false_times,
        }

    def _sent(self) -> dict[str, int]:
        """Totals of all boards: packets, repeated ones, overtaken ones, those that the line did not take."""
        names = ("made", "again", "overtaken", "lost")
        return {name: sum(getattr(board, name) for board in self.boards.values()) for name in names}

    def _status(self) -> Counter[str]:
        """The counters of all pads, just after they changed: the daemon reports them once a second."""
        first, until = None, time.monotonic() + STATUS_S
        while True:
            counted: Counter[str] = Counter()
            for pad in self._daemon.request("status", timeout_s=PATIENCE_S)["pads"]:
                counted.update({name: pad[name] for name in ("frames", "dropped", "repeated", "gaps")})
            first = first or counted
            if counted["frames"] != first["frames"] or time.monotonic() > until:
                return counted
            self._tick()

    def _counted(self, judge: Heard) -> dict[str, Any]:
        return {
            "cases": sum(len(each) for name, each in self.slowest.items() if name.startswith("after"))
            + len(self.never),
            "judged": judge.judged,
            "judged_pressed": judge.judged_pressed,
            "wrong": sum(judge.kinds.values()),
            "wrong_kinds": dict(judge.kinds),
            "false_times": judge.false_times,
            "published_twice": judge.twice.total(),
            "health": dict(judge.health),
        }


def failures(facts: dict[str, Any]) -> list[str]:
    """The conditions that are violated."""
    leaps, orders = facts["leaps"], facts["orders"]
    found = [f"not ok within a second: {case}" for case in leaps["not_ok_within_1_s"]]
    for when, slowest in leaps["slowest_ms"].items():
        found += [f"{ms} ms {when}: {case}" for ms, case in slowest if ms * 1_000_000 > SOON_NS]
    for where, counted in {"leaps": leaps, **orders}.items():
        found += [f"{where}: {counted[name]} {name}" for name in ("wrong", "published_twice") if counted[name]]
        found += [f"{where}: {counted['false_times']} false times"] if counted["false_times"] else []
    for order, counted in orders.items():
        found += [f"{order}: {fault}" for fault in miscounted(counted)]
    return found


def miscounted(counted: dict[str, Any]) -> list[str]:
    """False statements of a phase's counters."""
    due = counted["made"] - counted["overtaken"] - counted["lost"]
    used, again = counted["frames"] - counted["dropped"], counted["again"] + counted["overtaken"]
    left_out = max(counted["dropped"] - again, 0)  # lost through a late computer; `gaps` cannot excuse silence
    found = []
    if used + left_out < (1.0 - INEXACT) * due or used < LEAST_USED * due:
        found.append(f"{used} frames used and {left_out} left out of {due}")
    if abs(counted["repeated"] - again) > INEXACT * again + COPIES * (left_out + counted["lost"]):
        found.append(f"{counted['repeated']} counted as repeated of {again} that came again or late")
    return found


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--pads", type=int, default=2)
    options.add_argument("--step", type=int, default=1, help="only every so many powers of two")
    arguments = options.parse_args()
    with tempfile.TemporaryDirectory(prefix="fmfts-") as folder:
        facts = Drill(Path(folder), arguments.pads, POWERS[:: arguments.step]).run()
    print(json.dumps(facts, indent=1))
    found = failures(facts)
    print("\n".join(found) or "every clock leap was over within 300 ms, and each sample counted once")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
