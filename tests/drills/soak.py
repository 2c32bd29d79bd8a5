"""Many pads for minutes with random faults: no wrong number, no late recovery, every frame accounted for.

Every frame that arrived is published or dropped (`frames` = contacts of frames + `dropped`); frames that were made but
never arrived are `gaps`. Before and after each fault that leaves board and line running, the boards report how many
they made: `frames` + `gaps` must have grown by as many.
"""

from __future__ import annotations

import argparse
import json
import queue
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from drills.pressed_board import PressedBoard
from drills.pressed_pad import Wrong
from drills.rig import PATIENCE_S, is_ok, send_garbage, summary
from drills.witness import Injected, Witness
from end_to_end.processes import BRIDGE_CONFIG, RunningDaemon
from fmfts_client import Contact

MUST_BE_NONE = ("wrong_numbers", "late_recoveries", "unaccounted", "faults_with_frames_astray")
FAULT_S = 0.4
BATCH = 256  # contacts of one pad that are judged at once: those of sixteen pads come too fast to be judged one by one
STATUS_NS = 1_000_000_000
ON_ITS_WAY_NS = 100_000_000  # from a board that is held to the daemon's counters; less than what makes a pad stale
STAYS = ("nack", "mux", "garbage")
HEALTHY_S = 1.0  # longest time until a pad is ok again; a longer one counts as a missed recovery, and is reported


class Rig:
    """One daemon, one board for each pad, one listener for all of them."""

    def __init__(self, folder: Path, pads: int, seed: int) -> None:
        self.folders = [folder / f"p{i}" for i in range(pads)]
        for board in self.folders:
            board.mkdir()
        entries = [BRIDGE_CONFIG.format(port=board / "board").replace("left", board.name) for board in self.folders]
        self.daemon = RunningDaemon(folder, "".join(entries))
        self.hosts: dict[str, PressedBoard] = {}
        self.health: dict[str, Contact] = {}
        self.published: Counter[str] = Counter()
        self.unheard: Counter[str] = Counter()
        self.wrong_numbers: list[Wrong] = []
        self.witness = Witness()
        self._seed = seed
        self._to_judge: dict[str, list[Contact]] = {}
        self._inbox: queue.SimpleQueue[Contact] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._ear: threading.Thread | None = None

    def plug(self, name: str) -> None:
        (folder,) = (folder for folder in self.folders if folder.name == name)
        if name in self.hosts:
            self.hosts[name].plug()
        else:
            self.hosts[name] = PressedBoard(folder, seed=1000 * self._seed + len(self.hosts))

    def record_baselines(self) -> None:
        for folder in self.folders:
            self.plug(folder.name)
            self.daemon.wait_for(lambda contact, name=folder.name: contact.pad == name and contact.sensors_ok == 0b1111)
            self.daemon.request("baseline", pad=folder.name, duration_s=1.0, timeout_s=PATIENCE_S)
        self.unplug_all()
        self.daemon.stop()
        self.daemon.start()
        self.daemon.wait_until_serving()
        subscribed = threading.Event()
        self._ear = threading.Thread(target=self._hear, args=(subscribed,))
        self._ear.start()
        subscribed.wait()

    def _hear(self, subscribed: threading.Event) -> None:
        """While a board is plugged in nobody reads its contacts, and ZeroMQ keeps only 256."""
        with self.daemon.subscribe() as messages:
            messages.receive(PATIENCE_S)
            subscribed.set()
            while not self._stopping.is_set():
                message = messages.receive(0.05)
                if message is not None:
                    self._inbox.put(Contact.from_message(message.body))

    def close(self) -> None:
        """Judged last, so that an error here leaves nothing running."""
        self._stopping.set()
        if self._ear is not None:
            self._ear.join()
        self.unplug_all()
        self.daemon.__exit__()
        for name in list(self._to_judge):
            self._judge(name)

    def unplug_all(self) -> None:
        for host in self.hosts.values():
            host.kill()

    def listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> float:
        """Judge new contacts; ends early when `until` holds. Returns the time that took."""
        start = time.monotonic()
        while (passed := time.monotonic() - start) < seconds and not until():
            try:
                contact = self._inbox.get(timeout=0.05)
            except queue.Empty:
                continue
            before = self.health.get(contact.pad)
            if before is not None:
                self.unheard[contact.pad] += contact.seq - before.seq - 1
            self.health[contact.pad] = contact
            # These two are reported while no frame comes; all others concern a frame.
            self.published[contact.pad] += contact.health not in ("stale", "disconnected")
            self.hosts[contact.pad].tend()
            to_judge = self._to_judge.setdefault(contact.pad, [])
            to_judge.append(contact)
            if len(to_judge) >= BATCH:
                self._judge(contact.pad)
        return passed

    def _judge(self, name: str) -> None:
        board, contacts = self.hosts[name], self._to_judge.pop(name, [])
        wrong = board.all_wrong(contacts)
        self.witness.saw(board, contacts, wrong)
        self.wrong_numbers += wrong

    def is_healthy(self, name: str, after_ns: int = 0) -> bool:
        """By a contact that was sampled after CLOCK_MONOTONIC `after_ns`."""
        last = self.health.get(name)
        return last is not None and is_ok(last) and last.sensors_ok == 0b1111 and last.t_sample_ns > after_ns

    def unaccounted(self, name: str) -> int:
        """Frames of the board minus those that the daemon counted: constant while board and line run."""
        host, now_ns = self.hosts[name], time.monotonic_ns()
        due_ns = self.status(name)["t_publish_ns"] + STATUS_NS
        while due_ns - now_ns < ON_ITS_WAY_NS:
            due_ns += STATUS_NS
        self.listen((due_ns - now_ns - ON_ITS_WAY_NS) * 1e-9)
        with host.held():
            made = host.frames()
            self.listen(ON_ITS_WAY_NS // 2 * 1e-9)
            # On a busy computer some may wait in the line for longer. The daemon reads that before it answers, and the
            # first answer may be one that it had already begun.
            for _ in range(2):
                self.status(name)
            read_ns = time.monotonic_ns()
            while (status := self.status(name))["t_publish_ns"] < read_ns:
                self.listen(0.005)
        return made - int(status["frames"]) - int(status["gaps"])

    def status(self, name: str) -> dict[str, Any]:
        """As last reported, which is once a second."""
        (status,) = (pad for pad in self.daemon.request("status")["pads"] if pad["pad"] == name)
        return dict(status)


def inject(rig: Rig, name: str, fault: str, chance: random.Random) -> int:
    """Make the fault, wait, and mend it; returns CLOCK_MONOTONIC of the mend."""
    host, sensor = rig.hosts[name], chance.randrange(4)
    injected = Injected(name, fault, time.monotonic_ns())
    rig.witness.faults.append(injected)
    match fault:
        case "replug":
            host.kill()
            rig.listen(FAULT_S)
            rig.plug(name)
        case "nack":
            host.tell(f"fault 0 {sensor} unplugged")
            rig.listen(FAULT_S)
            host.tell(f"fault 0 {sensor} none")
        case "mux":
            host.tell("mux 0 unplugged")
            rig.listen(FAULT_S)
            host.tell("mux 0 none")
        case "garbage":
            send_garbage(host, 500, chance.randrange(1, 10**9), rig.listen)
        case "reset":
            host.tell("truncate")
            host.tell("reset")
    injected.mended_ns = time.monotonic_ns()
    return injected.mended_ns


def soak(folder: Path, pads: int, seconds: float, seed: int) -> dict[str, Any]:
    chance = random.Random(seed)
    rig = Rig(folder, pads, seed)
    recoveries: list[tuple[float, str]] = []
    faults: Counter[str] = Counter()
    astray: Counter[str] = Counter()  # faults after which more or fewer frames were counted than made
    try:
        rig.record_baselines()
        names = [board.name for board in rig.folders]
        for name in names:
            rig.plug(name)
        rig.listen(PATIENCE_S, lambda: all(rig.is_healthy(name) for name in names))
        for host in rig.hosts.values():
            host.press()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            name, fault = chance.choice(names), chance.choice(("replug", "nack", "mux", "garbage", "reset"))
            faults[fault] += 1
            before = rig.unaccounted(name) if fault in STAYS else 0
            mended_ns = inject(rig, name, fault, chance)
            rig.listen(PATIENCE_S, lambda name=name, after=mended_ns: rig.is_healthy(name, after))
            recoveries.append(((time.monotonic_ns() - mended_ns) * 1e-9, fault))
            if fault in STAYS and (now := rig.unaccounted(name)) != before:
                astray[fault] += 1
                print(f"{name} {fault}: {now - before} frames astray", file=sys.stderr)
        rig.unplug_all()
        rig.listen(3.0)  # only silence and the last status still arrive
        status = {pad["pad"]: pad for pad in rig.daemon.request("status")["pads"]}
    finally:
        rig.close()
    missing = {n: status[n]["frames"] - status[n]["dropped"] - rig.published[n] for n in names}
    # By the contacts' numbers, this listener missed some contacts of frames and some of silence.
    unaccounted = {n: max(missing[n] - rig.unheard[n], -missing[n], 0) for n in names}
    return {
        "pads": pads,
        "seconds": seconds,
        "seed": seed,
        "faults": dict(faults),
        "wrong_numbers": len(rig.wrong_numbers),
        "wrong_in": dict(Counter(one.kind for one in rig.wrong_numbers)),
        "first_wrong": rig.witness.accounts,
        "late_recoveries": sum(took_s > HEALTHY_S for took_s, _ in recoveries),
        "recoveries": {fault: summary([took_s for took_s, what in recoveries if what == fault]) for fault in faults},
        "published": sum(rig.published.values()),
        "dropped": sum(pad["dropped"] for pad in status.values()),
        "never_arrived": sum(pad["gaps"] for pad in status.values()),
        "unheard_by_the_drill": sum(rig.unheard.values()),
        "unaccounted": sum(unaccounted.values()),
        "faults_with_frames_astray": sum(astray.values()),
        "judged": sum(host.judged for host in rig.hosts.values()),
        "judged_pressed": sum(host.judged_pressed for host in rig.hosts.values()),
        "rate_hz": round(sum(rig.published.values()) / seconds / pads, 1),
    }


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--pads", type=int, default=16)
    options.add_argument("--seconds", type=float, default=600.0)
    options.add_argument("--seed", type=int, default=4, help="of the faults and the fingers (4)")
    arguments = options.parse_args()
    with tempfile.TemporaryDirectory(prefix="fmfts-") as folder:
        facts = soak(Path(folder), arguments.pads, arguments.seconds, arguments.seed)
    print(json.dumps(facts, indent=1))
    return int(any(facts[name] for name in MUST_BE_NONE))


if __name__ == "__main__":
    sys.exit(main())
