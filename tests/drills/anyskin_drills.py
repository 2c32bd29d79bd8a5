"""Drills with an AnySkin board, its firmware left as it is: unplugged, garbage, half packets, another baud rate.

The stream has no check sum and no times. A pad of ours lies above the board, and is pressed.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drills.pressed_pad import PressedPad
from drills.rig import Ear, descriptors, hear_a_press, is_not_ok, is_ok, none_wrong, summary
from emulator.anyskin_board import binary
from emulator.anyskin_on_pty import Board
from emulator.uart_line import read_at
from end_to_end.processes import RunningDaemon

Facts = dict[str, Any]
RATE_HZ = 200
CONFIG = """
[[pad]]
name = "skin"
[pad.source]
type = "anyskin"
port = "{port}"
form = "binary"
rate_hz = {rate_hz}
"""
BACK_S = 0.7  # between two faults: numbers are judged, and the finger moves
SENT_BAUD, OTHER_BAUDS = 115_200, (9_600, 57_600, 230_400, 460_800)
WRONG_BAUD_S = 1.2
BURST_BYTES = 1000


class PressedSkin(PressedPad):
    """Four magnetometers at the standard pad's places, so that the shipped model fits."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.board: Board | None = None
        self.plug()

    def plug(self) -> None:
        board = Board(self.folder, RATE_HZ, binary)
        board.field_t = np.zeros((4, 3))
        self.board = board
        self._move(self._touch)
        board.__enter__()

    def pull(self) -> None:
        if self.board is not None:
            self.board.pull()
        self.board = None

    def is_plugged(self) -> bool:
        return self.board is not None

    def field(self, field_t: np.ndarray) -> None:
        assert self.board is not None
        self.board.field_t = field_t


@contextmanager
def calibrated_skin(folder: Path) -> Iterator[tuple[RunningDaemon, PressedSkin, Ear]]:
    skin = PressedSkin(folder)
    try:
        config = CONFIG.format(port=folder / "skin", rate_hz=RATE_HZ)
        with RunningDaemon(folder, config) as daemon:
            daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
            daemon.request("baseline", pad="skin", rest=True, duration_s=1.0, timeout_s=30.0)
            with daemon.subscribe() as messages:
                ear = Ear(messages, skin.wrong, skin.tend)
                ear.until(is_ok)
                skin.press()
                yield daemon, skin, ear
                hear_a_press(ear, skin)
    finally:
        skin.pull()


def unplugged(folder: Path, cycles: int) -> Facts:
    """The plug is pulled for between 0 and 1.2 s; the board comes back as another pty."""
    chance = random.Random(1)
    with calibrated_skin(folder) as (daemon, skin, ear):
        before, recoveries = descriptors(daemon.process.pid), []
        for _ in range(cycles):
            skin.pull()
            ear.until(is_not_ok)
            ear.listen(chance.uniform(0.0, 1.2))
            skin.plug()
            recoveries.append(ear.recovered(time.monotonic_ns()))
            ear.listen(BACK_S)
        leaked = descriptors(daemon.process.pid) - before
        facts = {"cycles": cycles, **summary(recoveries), "descriptors_leaked": leaked}
        assert leaked == 0, facts
    return facts | none_wrong(ear, skin)


def damaged(folder: Path, packets: int) -> Facts:
    """A third of the damaged packets has random bytes before it, a third loses some bytes, a third is cut off."""
    chance = random.Random(2)

    def longer(packet: bytes) -> bytes:
        return chance.randbytes(chance.randrange(1, BURST_BYTES)) + packet

    def shorter(packet: bytes) -> bytes:
        start = chance.randrange(len(packet))
        return packet[:start] + packet[start + 1 + chance.randrange(8) :]

    def half(packet: bytes) -> bytes:
        return packet[: chance.randrange(len(packet))]

    kinds: tuple[Callable[[bytes], bytes], ...] = (longer, shorter, half)
    with calibrated_skin(folder) as (daemon, skin, ear):
        recoveries = []
        for number in range(packets):
            assert skin.board is not None
            skin.board.damage = kinds[number % len(kinds)]
            while skin.board.damage is not None:
                ear.listen(0.005)
            recoveries.append(ear.recovered(time.monotonic_ns()))
            ear.listen(0.05)
        ear.listen(1.2)
        garbage = daemon.request("status")["pads"][0]["garbage_bytes"]
        assert garbage > packets, garbage  # false: nothing was damaged
    return {"packets": packets, **summary(recoveries), "counted_as_garbage": garbage} | none_wrong(ear, skin)


def other_baud(folder: Path, cycles: int) -> Facts:
    """For a second the line has another baud rate than the port; then they agree again."""
    with calibrated_skin(folder) as (_, skin, ear):
        recoveries = []
        for cycle in range(cycles):
            assert skin.board is not None
            skin.board.line = partial(read_at, sent_baud=SENT_BAUD, read_baud=OTHER_BAUDS[cycle % len(OTHER_BAUDS)])
            ear.until(lambda contact: contact.health == "disconnected" and contact.reason.endswith("something else?"))
            ear.listen(WRONG_BAUD_S)
            skin.board.line = bytes
            recoveries.append(ear.recovered(time.monotonic_ns()))
            ear.listen(BACK_S)
    return {"cycles": cycles, **summary(recoveries)} | none_wrong(ear, skin)
