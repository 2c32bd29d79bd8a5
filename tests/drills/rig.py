"""Shared by the drills: a board whose true press is known, its daemon, and a listener that judges each number."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from drills.pressed_board import PressedBoard
from drills.pressed_pad import PressedPad
from end_to_end.processes import BRIDGE_CONFIG, FirmwareHost, RunningDaemon
from fmfts_client import Contact, Subscription

PATIENCE_S = 20.0


@dataclass
class Ear:
    """Listens to one daemon without a pause, and judges every message. tend: called meanwhile."""

    messages: Subscription
    judge: Callable[[Contact], str]
    tend: Callable[[], None] = lambda: None
    heard: int = 0
    wrong_numbers: list[str] = field(default_factory=list)

    def next(self, patience_s: float = PATIENCE_S) -> Contact:
        self.tend()
        message = self.messages.receive(patience_s)
        assert message is not None, f"silence for {patience_s} s"
        contact = Contact.from_message(message.body)
        self.heard += 1
        verdict = self.judge(contact)
        if verdict:
            self.wrong_numbers.append(verdict)
        return contact

    def until(self, wanted: Callable[[Contact], bool], patience_s: float = PATIENCE_S) -> float:
        """Seconds until a message came for which `wanted` holds."""
        start = time.monotonic()
        while not wanted(last := self.next()):
            assert time.monotonic() - start < patience_s, f"nothing of the kind in {patience_s} s; last: {last}"
        return time.monotonic() - start

    def recovered(self, mended_ns: int, wanted: Callable[[Contact], bool] | None = None) -> float:
        """Seconds from CLOCK_MONOTONIC `mended_ns` to a contact that was sampled after it, and for which `wanted` holds
        (None: that it is ok)."""
        wanted = wanted or is_ok
        self.until(lambda contact: wanted(contact) and contact.t_sample_ns > mended_ns)
        return (time.monotonic_ns() - mended_ns) * 1e-9

    def listen(self, seconds: float) -> list[Contact]:
        end = time.monotonic() + seconds
        heard = []
        while time.monotonic() < end:
            heard.append(self.next())
        return heard


def is_ok(contact: Contact) -> bool:
    return contact.health == "ok"


def is_not_ok(contact: Contact) -> bool:
    return contact.health != "ok"


@contextmanager
def calibrated(folder: Path) -> Iterator[tuple[RunningDaemon, PressedBoard, Ear]]:
    """The daemon on an emulated board, its baseline recorded at rest; its pad is pressed while the ear listens."""
    board = PressedBoard(folder)
    try:
        with RunningDaemon(folder, BRIDGE_CONFIG.format(port=board.port)) as daemon:
            daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
            recorded = daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config)
            assert recorded.returncode == 0, recorded.stderr
            with daemon.subscribe() as messages:
                ear = Ear(messages, board.wrong, board.tend)
                ear.until(is_ok)
                board.press()
                yield daemon, board, ear
                hear_a_press(ear, board)
    finally:
        board.kill()


def hear_a_press(ear: Ear, board: PressedPad) -> None:
    """Listens until a press has been judged: in a short drill each press may have coincided with a fault."""
    ear.until(lambda _: board.judged_pressed > 0)


def none_wrong(ear: Ear, board: PressedPad | None = None) -> dict[str, int]:
    """The number of judged messages. AssertionError with the first wrong numbers, or if no press could be judged."""
    assert not ear.wrong_numbers, ear.wrong_numbers[:3]
    if board is None:
        return {"judged": ear.heard}
    assert board.judged_pressed
    return {"judged": board.judged, "judged_pressed": board.judged_pressed}


def send_garbage(host: FirmwareHost, size: int, seed: int, wait: Callable[[float], object]) -> None:
    """Send random bytes; on a busy computer the line may be full of unread bytes."""
    while host.ask(f"garbage {size} {seed}") != "ok":
        wait(0.05)


def longest_gap_s(heard: Sequence[Contact]) -> float:
    return round(max((b.t_publish_ns - a.t_publish_ns) * 1e-9 for a, b in pairwise(heard)), 3)


def descriptors(pid: int) -> int:
    return len(os.listdir(f"/proc/{pid}/fd"))


def resident_kb(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0])


def summary(times_s: list[float]) -> dict[str, float]:
    ordered = sorted(times_s)
    middle = ordered[len(ordered) // 2]
    return {"median_s": round(middle, 3), "longest_s": round(ordered[-1], 3)}
