"""A board on a pty that records every frame: when it was taken, and what touched its pad."""

from __future__ import annotations

import os
import random
import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

from drills.chaos.faults import CHIPS, LINES, ORDERS, REPEATED
from drills.chaos.pressed import GAIN_CODE, MARKS, RATE_HZ, Finger, Library, Touch, counts_of
from emulator.board import Board
from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import Sample, Status, StatusPad

PERIOD_NS = 1_000_000_000 // RATE_HZ
ROUNDS = 2  # rounds of stored watermarks: 18 seconds
STATUS_EVERY = RATE_HZ
ALL_LINES = LINES | ORDERS
TIMES = 2**48  # times on the wire: a board's clock is sent as 48 bits
NOT_TOLD = Touch(0.0, 0.0, 0.0, 0)


class Taken(NamedTuple):
    """When a frame was taken, and what touched the pad. sampled_ns: time of its newest sample, maybe long before."""

    taken_ns: int
    touch: Touch
    sampled_ns: int


class ChaosBoard(Board):
    """`tick` sends the frames that are due. `faults`: the present ones, each with its end.

    written: frames that the line took completely. lost: frames that were taken but lost or damaged on the way. again,
    overtaken: packets that ORDERS repeated, or sent after a newer one.
    """

    def __init__(self, link: Path, uid: bytes, library: Library, seed: int) -> None:
        super().__init__(link, uid)
        self.gain_code = GAIN_CODE
        self._library, self._finger, self._dice = library, Finger(library, seed), random.Random(seed)
        self.faults: dict[str, int] = {}
        self.last_touch = NOT_TOLD
        self.by_mark: dict[int, deque[Taken]] = {mark: deque(maxlen=ROUNDS) for mark in range(MARKS)}
        self.made = self.written = self.lost = self.again = self.overtaken = 0
        self._lines: deque[bytes] = deque(maxlen=REPEATED)
        self._born_ns = self._due_ns = time.monotonic_ns()
        self._rest = self.held_back = b""
        # This many more frames have a time that is wrong by `leap_us`; when the first and the last of them were taken.
        self.age_us = self.leap_us = self.leaping_frames = self.leap_began_ns = self.leapt_ns = 0
        self._lifted_for = 0
        self._old: Sample | None = None
        self._sampled_ns = self._born_ns  # when `_old` was
        self.is_plugged = True

    def tick(self, now_ns: int) -> None:
        if not self.is_plugged:
            self._due_ns = now_ns
            return
        self.serve()
        if now_ns - self._due_ns > 50 * PERIOD_NS:  # this drill was stopped: a real board would have continued
            self._due_ns = now_ns
        while self._due_ns <= now_ns:
            self._due_ns += PERIOD_NS
            self._frame(time.monotonic_ns())

    def rested_ns(self, now_ns: int) -> int:
        """When the finger left the pad; the present time while it touches."""
        last = self.last_touch
        return now_ns if last.force_n > 0.0 else now_ns - last.standing * PERIOD_NS

    def _frame(self, now_ns: int) -> None:
        sequence = self.sequence[0]
        self.sequence[0] = (sequence + 1) % 2**32
        touch, field_t = self._finger.next()
        leap_us = self.leap_us if self.leaping_frames else 0
        self.leaping_frames = max(self.leaping_frames - 1, 0)
        self.time_us = ((now_ns - self._born_ns) // 1000 + self.age_us + leap_us) % TIMES
        if leap_us:
            self.leapt_ns = now_ns
            self.leap_began_ns = self.leap_began_ns or now_ns
        now = [name for name in self.faults if self.faults[name] > now_ns]
        if "lifted" in now:
            since = self._lifted_for = self._lifted_for + 1
            touch, field_t = NOT_TOLD._replace(standing=since), self._library.lifted_t
        else:
            self._lifted_for = 0
        mark = self.made % MARKS  # not the frame's number, which restarts with each reset
        counts = counts_of(self._library, field_t, mark)
        sample = self.sample(sequence=sequence, counts=counts, temperature_raw=mark - MARKS // 2)
        self.sequence[0] = (sequence + 1) % 2**32
        for name in now:
            if name in CHIPS:
                sample = CHIPS[name](sample, self._old or sample, self._dice)
        if "stale" not in now and "frozen" not in now:
            self._old, self._sampled_ns = sample, now_ns
        self.last_touch = touch
        self.by_mark[mark].append(Taken(now_ns, touch, self._sampled_ns))
        self.made += 1
        line = encode(sample)
        data, whole = line, True
        for name in now:
            if name in ALL_LINES and data:
                data, is_whole = ALL_LINES[name](self, sample, data, self._dice)
                whole &= is_whole
        self._lines.append(line)
        if sequence % STATUS_EVERY == 0:
            data += encode(Status(self.time_us, 0, 0, (StatusPad(0, 0, 0, (0,) * 4),)))
        if self._put(data) and whole:
            self.written += 1
        else:
            self.lost += 1

    def _put(self, data: bytes) -> bool:
        """False if the line was full and took nothing of it. What it took in part is finished first."""
        try:
            if self._rest:
                self._rest = self._rest[os.write(self.master, self._rest) :]
                if self._rest:
                    return False
            if data:
                self._rest = data[os.write(self.master, data) :]
            return True
        except OSError:
            return False

    def lines_ago(self, count: int) -> list[bytes]:
        """Send this many lines of a second ago."""
        return list(self._lines)[:count]

    def unplug(self) -> None:
        if self.is_plugged:
            super().unplug()
            self.is_plugged = False

    def plug(self) -> None:
        super().plug()
        self.is_plugged, self._rest = True, b""

    def reset(self, hello: bool) -> None:
        """Restart the firmware. hello: it arrives."""
        self._born_ns = time.monotonic_ns()
        self.sequence = [0]
        self._lines.clear()
        if hello and self.is_plugged:
            self._put(encode(self.hello()))

    def send(self, *packets: object) -> None:
        self._put(b"".join(encode(packet) for packet in packets))  # type: ignore[arg-type]
