"""Drives a G-code machine on a serial port: moves it within its travel, reads its position, halts it at any time."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass

from fmfts.sensor.bridge import serial_port
from fmfts_collect.clock import Clock
from fmfts_collect.dialect import DIALECTS, Answer, Dialect, Place
from fmfts_collect.errors import AbsentError, RefusedError, StoppedError
from fmfts_collect.guard import Rescue
from fmfts_collect.settings import StageConfig

BOOT_S = 8.0  # opening the port resets many boards; a boot loader takes its time
ANSWER_S = 1.0
HOMING_S = 120.0
SHORT_S = 0.05  # a move shorter than this need not be halted: the next command runs soon enough
LATE_S = 2.0  # a move that takes this much longer than calculated has stalled
ASK_S = 0.02
HALTED_S = 0.1
STANDS_S = 1.0  # time to slow down after a halt
RESET_S = 1.0
ARRIVED_MM = 0.02
TURN_S = 0.001
SENT_S = 0.1  # enough to send five bytes; closing the port discards bytes that were not sent


@dataclass(frozen=True, slots=True)
class _UnderWay:
    """A move that was sent. ends_s: when it should end; low_mm: z of its lower end; up: it only goes up."""

    ends_s: float
    low_mm: float
    up: bool


class Machine:
    """A G-code machine. It calls `listen` all the time while it waits; after `listen` raises, call `halt` or `rise`."""

    def __init__(self, config: StageConfig, clock: Clock) -> None:
        self.place: Place | None = None  # its position, as last reported
        self.homed: bool | None = None  # None before homing, False during it: `place` is not valid then
        self.trouble = ""
        self.listen: Callable[[], None] = lambda: None
        self.heartbeat: Callable[[], None] = lambda: None  # called before each move, and while the rod rises
        self._config = config
        self._clock = clock
        self._dialect: Dialect = DIALECTS[config.dialect]
        self._answers_due = 0
        self._standing: bool | None = False  # None: the machine has not reported yet
        self._started = False
        self._position_lost = False  # the controller was reset: its coordinates are different now
        self._under_way: _UnderWay | None = None
        self._rest = b""
        try:
            self._port = serial_port.open_raw(config.port, config.baud)
        except OSError as error:
            why = serial_port.why_not_open(config.port, error).replace("board", "machine")
            raise AbsentError(f"stage: {config.port} {why}") from error

    def begin(self) -> None:
        """Set up and home. Raises AbsentError where it does not answer, StoppedError where homing fails."""
        end_s = self._now_s() + BOOT_S
        while not self._answers():
            if self._now_s() > end_s:
                raise AbsentError(
                    f"stage: {self._config.port} does not answer: is it a {self._config.dialect} machine, at "
                    f"{self._config.baud} baud?"
                )
        self._started = True  # from here on, a start message means a reset
        self._send(*self._dialect.unlock, *self._dialect.set_up)
        self._wait(lambda: self._answers_due == 0, ANSWER_S)
        self.trouble = ""
        self.homed = False
        self._carry_out(self._dialect.home, HOMING_S)
        self.homed = True

    def move(
        self, x: float | None = None, y: float | None = None, z: float | None = None, mm_per_s: float = 1.0
    ) -> None:
        """Move straight to a place (mm; None: keep this coordinate), and wait until it stands there.

        Raises RefusedError for a place outside the travel, StoppedError where it does not arrive.
        """
        assert self.place is not None  # homed
        target = tuple(now if new is None else new for new, now in zip((x, y, z), self.place, strict=True))
        for axis, value, (low, high) in zip("xyz", (x, y, z), self._config.travel_mm, strict=True):
            if value is not None and not low <= value <= high:
                raise RefusedError(f"{axis} = {value:.3f} mm is outside collect.stage.travel_mm ({low:g} to {high:g})")
        self.heartbeat()  # a collector that was stopped must not press on where its guard has lifted the rod
        seconds = math.dist(target, self.place) / mm_per_s
        up = target[2] > self.place[2] and target[:2] == self.place[:2]
        self._under_way = _UnderWay(self._now_s() + seconds, min(target[2], self.place[2]), up)
        self._carry_out((self._dialect.move((target[0], target[1], target[2]), mm_per_s),), seconds + LATE_S)
        self._under_way = None
        if math.dist(target, self.place) > ARRIVED_MM:
            raise StoppedError(f"the stage stands at {_shown(self.place)} instead of {_shown(target)}: did it stall?")
        self.place = (target[0], target[1], target[2])  # exact, while Marlin reports it rounded to 0.01 mm

    def rescue(self, z_mm: float, mm_per_s: float) -> Rescue:
        """The commands that lift the rod to that height from anywhere, for the guard, after this process has died."""
        dialect, farthest_mm = self._dialect, z_mm - self._config.travel_mm[2][0]
        rise = "".join(f"{line}\n" for line in (*dialect.unlock, *dialect.rise(z_mm, mm_per_s))).encode()
        # The guard reads no answers, so it always resets GRBL. It does not halt Marlin: Marlin presses by short moves,
        # and lifts sooner without a halt.
        prepare = ((dialect.halt, 2 * HALTED_S), (dialect.reset, 2 * HALTED_S)) if dialect.reset else ()
        return Rescue((*prepare, (rise, farthest_mm / mm_per_s + LATE_S)))

    def fileno(self) -> int:
        return int(self._port.fileno())

    def lowest_mm(self) -> float:
        """The machine's z or, during a move, the z of its lower end."""
        assert self.place is not None
        return self.place[2] if self._under_way is None else self._under_way.low_mm

    def halt(self) -> bool:
        """Halt the present move, and return True; False where none is, or where it ends soon by itself or goes up."""
        move = self._under_way
        if move is None:
            return False
        left_s = move.ends_s - self._now_s()
        if self._dialect.halt_s and left_s > -2 * SHORT_S and (move.up or left_s < 2 * SHORT_S):
            return False
        self._write(self._dialect.halt)
        return True

    def rise(self, z_mm: float, mm_per_s: float) -> bool:
        """Halt, and go up; returns whether the machine reports that it did. Does not call `listen`, which may raise."""
        self.listen = self.heartbeat
        locked, low_mm = bool(self.trouble), self.lowest_mm()
        way_mm, lines = z_mm - low_mm, self._dialect.rise(z_mm, mm_per_s)
        if self._position_lost:
            low_mm, lines = 0.0, self._dialect.rise_by(way_mm, mm_per_s)
        try:
            pause_s = self._dialect.halt_s if self.halt() else 0.0
            self._under_way = self.place = None
            end_s = self._now_s() + pause_s + way_mm / mm_per_s + LATE_S
            while self._now_s() < end_s:
                self._make_ready(locked)
                self._send(*lines, *self._dialect.settle)
                if self._wait(
                    lambda: self.place is not None and self.place[2] > low_mm + 0.5 * way_mm, end_s - self._now_s()
                ):
                    return True
                if self._position_lost:
                    return False  # a second relative move would go twice as high
                locked = True  # a limit switch that bounces when it is released locks GRBL again
        except AbsentError:
            return False
        return False

    def _make_ready(self, locked: bool) -> None:
        """Makes GRBL accept a jog: waits until it stands, or resets it, which a limit's alarm makes necessary."""
        self.trouble, self._answers_due, self._standing = "", 0, None
        if not self._dialect.reset:
            return
        if not locked and self._wait(lambda: self._standing is not None, HALTED_S) and not self.trouble:
            self._wait(lambda: bool(self._standing), STANDS_S)
            if not self.trouble:
                return
        self._started = False
        self._write(self._dialect.reset)
        self._insist(lambda: self._started, RESET_S)
        self._answers_due = 0
        self._send(*self._dialect.unlock)
        self._insist(lambda: self._answers_due == 0, ANSWER_S)
        self.trouble, self._answers_due = "", 0

    def _insist(self, done: Callable[[], bool], seconds: float) -> None:
        """Waits until `done` or until the time is over, and ignores troubles that the machine reports."""
        end_s = self._now_s() + seconds
        while not done() and self._now_s() < end_s:
            self.trouble = ""
            self._wait(done, end_s - self._now_s())

    def emergency_stop(self) -> None:
        """Send the emergency stop. The machine must be reset by hand afterwards."""
        try:
            self._write(self._dialect.emergency)
        except AbsentError:
            return
        self._clock.sleep(SENT_S)

    def close(self) -> None:
        serial_port.close(self._port)

    def _answers(self) -> bool:
        """Sends a command and returns whether it is answered. A board that boots loses commands, so call it again."""
        self._answers_due = 0
        self._send(*self._dialect.unlock, self._dialect.set_up[0])
        if not self._wait(lambda: self._answers_due == 0, ANSWER_S):
            self.trouble = ""
            return False
        self._wait(lambda: False, HALTED_S)  # receive the answers to earlier commands
        self._answers_due = 0
        return True

    def _carry_out(self, lines: tuple[str, ...], seconds: float) -> None:
        """Sends lines and waits until the machine stands. Raises StoppedError on trouble, or after `seconds`."""
        self._standing = False
        self._send(*lines, *self._dialect.settle)
        arrived = self._wait(lambda: self._answers_due == 0 and bool(self._standing), seconds)
        if self.trouble:
            raise StoppedError(f"the stage says: {self.trouble}")
        if not arrived:
            where = _shown(self.place)
            raise StoppedError(
                f"the stage did not end `{lines[-1]}` within {seconds:.1f} s, and was at {where}: it stalled"
            )

    def _wait(self, done: Callable[[], bool], seconds: float) -> bool:
        """Waits until `done`, until trouble, or until the time is over; returns `done`."""
        end_s = self._now_s() + seconds
        ask_s = self._now_s()
        while True:
            self._read()
            if done() or self.trouble:
                return done()
            now_s = self._now_s()
            if now_s >= end_s:
                return False
            if self._dialect.ask and now_s >= ask_s and self._answers_due == 0:
                ask_s = now_s + ASK_S
                self._write(self._dialect.ask)
            self.listen()
            self._clock.sleep(TURN_S)

    def _now_s(self) -> float:
        return self._clock.now_ns() * 1e-9

    def _send(self, *lines: str) -> None:
        if lines:
            self._answers_due += len(lines)
            self._write("".join(f"{line}\n" for line in lines).encode())

    def _write(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._port.fileno(), data) :]
            except BlockingIOError:
                self._clock.sleep(TURN_S)
            except OSError as error:
                raise AbsentError(f"stage: {self._config.port} is gone ({error.strerror})") from error

    def _read(self) -> None:
        try:
            data = os.read(self._port.fileno(), 4096)
        except BlockingIOError:
            return
        except OSError as error:
            raise AbsentError(f"stage: {self._config.port} is gone ({error.strerror})") from error
        if not data:
            raise AbsentError(f"stage: {self._config.port} hung up")
        *lines, self._rest = re.split(rb"[\r\n]+", self._rest + data)
        for line in filter(None, lines):
            self._take(self._dialect.read(line.decode("ascii", "replace").strip()))

    def _take(self, answer: Answer) -> None:
        if answer.ok:
            self._answers_due = max(0, self._answers_due - 1)
        if answer.place is not None:
            self.place = answer.place
        # While a command is not answered yet, an answer to `ask` may describe the time before the command.
        if answer.standing is not None and (not self._dialect.ask or self._answers_due == 0):
            self._standing = answer.standing
        if answer.trouble:
            self.trouble = self.trouble or answer.trouble
        if answer.started:
            if self._started and self.place is not None:
                self.trouble = self.trouble or "it was reset"
                self._position_lost = True
            self._started = True


def _shown(place: tuple[float, ...] | None) -> str:
    return "an unknown place" if place is None else "(" + ", ".join(f"{value:.3f}" for value in place) + ") mm"
