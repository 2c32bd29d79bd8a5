"""Every fault at random, in pairs, on many touched pads, with random load: is any number wrong?

    PYTHONPATH=tests python -m drills.chaos.drill --frames 10000000

Boards on ptys record when they took each frame, and what touched the pad. A watermark names the frame of each contact,
which is judged by that frame and by its true age. Every fault lasts for some tenths of a second, two at a time on one
pad; a pad that is not `ok` one second after its last fault counts as stuck.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from drills.chaos.board import ChaosBoard
from drills.chaos.faults import CHIPS, GLOBAL, LINES, OTHERS
from drills.chaos.judge import Judge
from drills.chaos.pressed import Library
from drills.control_fuzz import random_request
from drills.strangers import SUBSCRIBED, strangers
from emulator.priority import put_ahead
from end_to_end.processes import PATIENCE_S, RunningDaemon
from fmfts.baseline.origin import Origin

CONFIG = """
[[pad]]
name = "{name}"
[pad.source]
type = "bridge"
port = "{port}"
uid = "{uid}"
"""
SHORTEST_S, LONGEST_S = 0.1, 1.0
HEALTHY_NS = 1_000_000_000
# A pad rests this long between two pairs of faults.
REST_S = 0.5
BETWEEN_GLOBAL_S = 3.0
# Pads in trouble at one time: Python judges their frames, which takes a hundred times as long as a healthy one.
MOST_IN_TROUBLE = 3
KEPT = 20
# If this user may. Other programs of this computer are not part of the drill, which makes its own load.
AHEAD = ("nice", "-n", "-10")


@dataclass
class Trouble:
    """The faults of one pad, the last of which ends at `ends_ns`; 0: it is healthy until `next_ns`."""

    faults: tuple[str, ...] = ()
    ends_ns: int = 0
    next_ns: int = 0
    is_latched: bool = False


@dataclass
class Drill:
    folder: Path
    pads: int
    seed: int
    any_age: bool = False
    faults: Counter[str] = field(default_factory=Counter)
    latches: list[dict[str, Any]] = field(default_factory=list)
    recoveries: list[tuple[float, tuple[str, ...]]] = field(default_factory=list)  # how many seconds; after which fault

    def __post_init__(self) -> None:
        self._dice = random.Random(self.seed)
        library = Library(self.seed)
        self._boards: dict[str, ChaosBoard] = {}
        state, config = self.folder / "state" / "fmfts" / "baseline", ""
        state.mkdir(parents=True)
        for number in range(self.pads):
            name, uid = f"p{number}", bytes([number + 1] * 12)
            port = self.folder / f"board{number}"
            self._boards[name] = ChaosBoard(port, uid, library, self.seed * 1000 + number)
            (state / f"{name}.json").write_bytes(library.baseline(name, Origin("bridge", "hmc5983", uid.hex(), 0)))
            config += CONFIG.format(name=name, port=port, uid=uid.hex())
        self._daemon = RunningDaemon(self.folder, config, wait=False, through=AHEAD)
        self._troubles = {name: Trouble() for name in self._boards}
        self._meanwhile = ExitStack()
        self._meanwhile_ends_ns = self._next_global_ns = 0
        self._disturbed_ns = 0  # when the last fault of the whole computer ended

    def run(self, frames: int, seconds: float) -> dict[str, Any]:
        """Run until this many frames were made, or this many seconds have passed."""
        put_ahead()
        self._daemon.wait_until_serving(self._tick, answer_s=0.05)
        judge = Judge(f"{self._daemon.base}/bus", self._boards)
        try:
            self._turn_until(lambda: len(judge.ok_ns) == self.pads, judge, PATIENCE_S)
            begun = time.monotonic()
            self._next_global_ns = time.monotonic_ns() + int(BETWEEN_GLOBAL_S * 1e9)
            while time.monotonic() - begun < seconds and sum(b.made for b in self._boards.values()) < frames:
                self._turn(judge, with_faults=True)
            self._end_meanwhile()
            self._turn_until(lambda: not any(each.ends_ns for each in self._troubles.values()), judge, PATIENCE_S)
            for board in self._boards.values():
                board.unplug()
            time.sleep(2.0)
            assert self._daemon.process.poll() is None, self._daemon.log.read_text()[-2000:]
            status = {pad["pad"]: pad for pad in self._daemon.request("status", timeout_s=PATIENCE_S)["pads"]}
        finally:
            judge.close()
            self._end_meanwhile()
            self._daemon.__exit__()
        return self._facts(judge, status, time.monotonic() - begun)

    def _turn_until(self, condition: Any, judge: Judge, patience_s: float) -> None:
        until = time.monotonic() + patience_s
        while not condition():
            assert time.monotonic() < until, (judge.last, self._daemon.log.read_text()[-2000:])
            self._turn(judge, with_faults=False)

    def _tick(self) -> None:
        for board in self._boards.values():
            board.tick(time.monotonic_ns())
        time.sleep(1e-3)

    def _turn(self, judge: Judge, with_faults: bool) -> None:
        self._tick()
        now_ns = time.monotonic_ns()
        for name, trouble in self._dice.sample(list(self._troubles.items()), self.pads):
            if trouble.ends_ns and now_ns > trouble.ends_ns:
                self._mended(name, trouble, judge, now_ns)
            elif (
                with_faults and not trouble.ends_ns and now_ns > trouble.next_ns and self._in_trouble < MOST_IN_TROUBLE
            ):
                self._begin(name, trouble, now_ns)
        if self._meanwhile_ends_ns and now_ns > self._meanwhile_ends_ns:
            self._end_meanwhile()
        elif with_faults and not self._meanwhile_ends_ns and now_ns > self._next_global_ns:
            self._begin_global(now_ns)

    @property
    def _in_trouble(self) -> int:
        return sum(trouble.ends_ns > 0 for trouble in self._troubles.values())

    def _begin(self, name: str, trouble: Trouble, now_ns: int) -> None:
        board, chosen = self._boards[name], self._dice.sample([*CHIPS, *LINES, *OTHERS], 2)
        trouble.faults = tuple(chosen)
        for fault in chosen:
            self.faults[fault] += 1
            ends_ns = now_ns + int(self._dice.uniform(SHORTEST_S, LONGEST_S) * 1e9)
            board.faults[fault] = ends_ns
            trouble.ends_ns = max(trouble.ends_ns, ends_ns)
            match fault:
                case "replug":
                    board.unplug()
                case "reset" | "reset unheard":
                    board.reset(hello=fault == "reset")

    def _mended(self, name: str, trouble: Trouble, judge: Judge, now_ns: int) -> None:
        board = self._boards[name]
        if not board.is_plugged:
            board.plug()
            trouble.ends_ns = now_ns
            return
        # Under a finger a pulled magnet cannot be distinguished from a baseline that was recorded under load.
        rested_ns = board.rested_ns(now_ns) if "lifted" in trouble.faults else 0
        since_ns = max(trouble.ends_ns, self._disturbed_ns, rested_ns)
        if judge.ok_ns.get(name, 0) > trouble.ends_ns:
            self.recoveries.append((max(now_ns - since_ns, 0) * 1e-9, trouble.faults))
        elif now_ns - since_ns < int(PATIENCE_S * 1e9):
            if not trouble.is_latched and self._is_latched(judge, name, since_ns, now_ns):
                trouble.is_latched = True
                told = {key: judge.last.get(name, {}).get(key) for key in ("health", "reason", "seq")}
                self.latches.append({"pad": name, "faults": trouble.faults} | told)
            return
        trouble.ends_ns, trouble.is_latched, trouble.next_ns = (
            0,
            False,
            now_ns + int(self._dice.uniform(0.5, 1.5) * REST_S * 1e9),
        )

    def _is_latched(self, judge: Judge, name: str, since_ns: int, now_ns: int) -> bool:
        """True if the pad has not recovered. any_age: judge by its frames' own times, however late they are
        published."""
        if self._meanwhile_ends_ns:
            return False
        taken_ns, health = judge.judged_until.get(name, (0, ""))
        if taken_ns - since_ns > HEALTHY_NS and health != "ok":
            return True
        return now_ns - since_ns > (10 if self.any_age else 1) * HEALTHY_NS

    def _begin_global(self, now_ns: int) -> None:
        fault = self._dice.choice(GLOBAL)
        self.faults[fault] += 1
        self._meanwhile_ends_ns = now_ns + int(self._dice.uniform(SHORTEST_S, LONGEST_S) * 1e9)
        match fault:
            case "load":
                for _ in range(self._dice.randrange(1, 2 * (os.cpu_count() or 1) + 1)):
                    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
                    self._meanwhile.callback(busy.wait)
                    self._meanwhile.callback(busy.kill)
            case "strangers":
                self._meanwhile.enter_context(strangers(self.folder / "bus", 300, SUBSCRIBED))
            case "stopped":
                self._daemon.process.send_signal(signal.SIGSTOP)
                self._meanwhile_ends_ns = now_ns + int(self._dice.uniform(0.05, 0.4) * 1e9)
                self._meanwhile.callback(self._daemon.process.send_signal, signal.SIGCONT)
            case "requests":
                self._ask_nonsense()
            case "deaf":
                self._meanwhile.enter_context(self._daemon.subscribe("contact", "status"))

    def _ask_nonsense(self) -> None:
        import zmq

        socket = self._meanwhile.enter_context(zmq.Context.instance().socket(zmq.DEALER))
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(f"{self._daemon.base}/control")
        for _ in range(100):
            socket.send(random_request(self._dice, harmless=True))

    def _end_meanwhile(self) -> None:
        self._meanwhile.close()
        now_ns = time.monotonic_ns()
        self._disturbed_ns = now_ns
        self._meanwhile_ends_ns, self._next_global_ns = 0, now_ns + int(BETWEEN_GLOBAL_S * 1e9)

    def _facts(self, judge: Judge, status: dict[str, Any], seconds: float) -> dict[str, Any]:
        boards = self._boards.values()
        ages_ms = sorted(age * 1e-6 for age in judge.ages_ns) or [0.0]
        missing = {n: status[n]["frames"] - status[n]["dropped"] - judge.published[n] for n in self._boards}
        unaccounted = {n: max(missing[n] - judge.unheard[n], -missing[n], 0) for n in self._boards}
        recoveries = sorted(self.recoveries) or [(0.0, ())]
        return {
            "frames": sum(board.made for board in boards),
            "written": sum(board.written for board in boards),
            "arrived": sum(pad["frames"] for pad in status.values()),
            "published": sum(judge.published.values()),
            "dropped": sum(pad["dropped"] for pad in status.values()),
            "unaccounted": sum(unaccounted.values()),
            "missing": missing,
            "unheard_by_the_drill": sum(judge.unheard.values()),
            "judged": judge.judged,
            "judged_pressed": judge.judged_pressed,
            "wrong": sum(judge.kinds.values()),
            "wrong_kinds": dict(judge.kinds),
            "wrong_while_two_of_four_chips_are_faulty": sum(judge.untold_kinds.values()),
            "wrong_by_faults": [[count, *what] for what, count in judge.by_faults.most_common(KEPT)],
            "ok_older_than_100_ms": judge.stale,
            "ok_with_a_false_time": judge.false_times,
            "false_times_by_faults": [[count, *what] for what, count in judge.false_times_by_faults.most_common(KEPT)],
            "old_by_faults": [[count, *what] for what, count in judge.stale_by_faults.most_common(KEPT)],
            "age_ms": {"p50": round(ages_ms[len(ages_ms) // 2], 1), "p99": round(ages_ms[len(ages_ms) * 99 // 100], 1)},
            "latches": self.latches[:KEPT],
            "latched": len(self.latches),
            "recovery_s": {
                "p50": round(recoveries[len(recoveries) // 2][0], 3),
                "longest": round(recoveries[-1][0], 3),
                "slowest": [[round(seconds, 2), *faults] for seconds, faults in recoveries[: -KEPT // 2 : -1]],
            },
            "health": dict(judge.health),
            "wrong_ones": [
                [pad, what, round(since_s, 2), _told(contact)] for pad, what, since_s, contact in judge.wrong
            ],
            "faults": dict(self.faults),
            "seconds": round(seconds, 1),
        }


def _told(contact: dict[str, Any]) -> dict[str, Any]:
    names = ("health", "reason", "seq", "force_n", "force_sd_n", "temperature_c")
    return {name: contact[name] for name in names}


MUST_BE_NONE = ("wrong", "unaccounted", "latched")
# If other programs occupy the processors, or the drill makes load, a daemon that cannot keep up shows here.
MUST_BE_NONE_IN_TIME = ("ok_older_than_100_ms", "ok_with_a_false_time")


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--pads", type=int, default=16)
    options.add_argument("--frames", type=int, default=10_000_000, help="that the boards take, all together")
    options.add_argument("--seconds", type=float, default=1e9, help="at most")
    options.add_argument("--any-age", action="store_true", help="old contacts are counted, and do not fail the drill")
    options.add_argument("--seed", type=int, default=1)
    arguments = options.parse_args()
    with tempfile.TemporaryDirectory(prefix="fmfts-") as folder:
        drill = Drill(Path(folder), arguments.pads, arguments.seed, arguments.any_age)
        facts = drill.run(arguments.frames, arguments.seconds)
    print(json.dumps(facts, indent=1))
    wanted = MUST_BE_NONE if arguments.any_age else (*MUST_BE_NONE, *MUST_BE_NONE_IN_TIME)
    return int(any(facts[name] for name in wanted))


if __name__ == "__main__":
    sys.exit(main())
