"""What drills share: a board whose true field is known, the daemon on it, and an ear that judges each number."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from end_to_end.processes import BRIDGE_CONFIG, FirmwareHost, RunningDaemon, resting_field
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad
from fmfts_client import Contact, Subscription

# A number is wrong when it is published with health ok and is further from the truth than five of its deviations.
DEVIATIONS = 5.0
PATIENCE_S = 20.0
STANDARD_PAD = PadConfig(name="standard", source=SimulatedSource()).pad()


def wrong(contact: Contact, pad: Pad = STANDARD_PAD) -> str:
    """What is wrong with a contact of an unloaded pad, "" where nothing is."""
    if contact.health != "ok":
        numbers = (contact.force_n, contact.x_m, contact.y_m) if contact.health != "degraded" else ()
        return f"{contact.health} with a number: {contact}" if any(value is not None for value in numbers) else ""
    if contact.pose is None:
        return f"ok without a pose: {contact}"
    off = np.abs(np.array(contact.pose.position_m) - pad.rest_position_m) / np.array(contact.pose.position_sd_m)
    if not (off <= DEVIATIONS).all():
        return f"the magnet {off} deviations off its rest: {contact}"
    return f"touched, and nothing touches it: {contact}" if contact.contact else ""


@dataclass
class Ear:
    """Listens to one daemon without a pause; every message is judged."""

    messages: Subscription
    judge: Callable[[Contact], str] = wrong
    heard: int = 0
    wrong_numbers: list[str] = field(default_factory=list)

    def next(self, patience_s: float = PATIENCE_S) -> Contact:
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
def calibrated(folder: Path) -> Iterator[tuple[RunningDaemon, FirmwareHost, Ear]]:
    """The daemon on an emulated board at rest, its baseline recorded."""
    host = plugged_in(folder)
    try:
        with RunningDaemon(folder, BRIDGE_CONFIG.format(port=host.port)) as daemon:
            daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
            recorded = daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config)
            assert recorded.returncode == 0, recorded.stderr
            with daemon.subscribe() as messages:
                ear = Ear(messages)
                ear.until(is_ok)
                yield daemon, host, ear
    finally:
        host.kill()


def plugged_in(folder: Path) -> FirmwareHost:
    host = FirmwareHost(folder)
    host.field(resting_field(STANDARD_PAD))
    return host


def send_garbage(host: FirmwareHost, size: int, seed: int, wait: Callable[[float], object]) -> None:
    """Random bytes on the line; on a busy computer it may be full of what was not fetched yet."""
    while host.ask(f"garbage {size} {seed}") != "ok":
        wait(0.05)


def descriptors(pid: int) -> int:
    return len(os.listdir(f"/proc/{pid}/fd"))


def resident_kb(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0])


def summary(times_s: list[float]) -> dict[str, float]:
    ordered = sorted(times_s)
    middle = ordered[len(ordered) // 2]
    return {"median_s": round(middle, 3), "longest_s": round(ordered[-1], 3)}
