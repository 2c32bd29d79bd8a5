"""A three-axis G-code machine on a pty: Marlin's or GRBL's protocol, finite speed, backlash, limit switches, stalls.

Written from the projects' own documentation; shares no code with the driver under test. Its time passes by `turn`;
`speed` makes it faster: feeds are multiplied by it.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from emulator.pty_port import PtyPort

CLEANING_S = 1.0  # after M410 Marlin drops moves (planner.cpp, quick_stop)
Place = list[float]


@dataclass
class Move:
    target: Place
    mm_per_s: float


class GcodeMachine:
    """homing_mm_per_s: None homes immediately. z_limit_mm_per_s: faster feeds are clamped silently; 5 is stock Marlin.
    `switch_mm`: z of a limit switch that ends all motion below it. `stalled`: motors turn but nothing moves.

    backlash_mm: an axis that comes from above stands higher by this than commanded.
    """

    def __init__(
        self, link: Path, dialect: str, *, backlash_mm: float = 0.0, speed: float = 1.0, z_limit_mm_per_s: float = 5.0
    ) -> None:
        self.port = PtyPort(link)
        self.home: Place = [98.0, 98.0, 13.0]
        self.backlash_mm = backlash_mm
        self.switch_mm: float | None = None
        self.stalled = False
        self.deaf = False
        self.homing_mm_per_s: float | None = None
        self.killed = False
        self.received: list[str] = []
        self.on_moved: Callable[[Place], None] = lambda place: None
        self._grbl = dialect == "grbl"
        self._speed = speed
        self._z_limit_mm_per_s = z_limit_mm_per_s
        self._cleaning_s = 0.0
        self._homing = False
        self._awaits_reset = False  # GRBL after a hard limit
        self._told = [10.0, 10.0, 20.0]  # where the motors assume the rod
        self._zero = [0.0, 0.0, 0.0]  # the origin of its coordinates
        self._from_above = [False, False, False]
        self._moves: deque[Move] = deque()
        self._held: deque[str] = deque()  # Marlin: lines that wait for the end of a move
        self._relative = self._alarm = False
        self._rest = b""

    def __enter__(self) -> GcodeMachine:
        self._say("Grbl 1.1h ['$' for help]" if self._grbl else "start")
        return self

    def __exit__(self, *_: object) -> None:
        self.port.unplug()

    @property
    def place(self) -> Place:
        """The rod's true position."""
        axes = zip(self._zero, self._told, self._from_above, strict=True)
        return [zero + told + self.backlash_mm * above for zero, told, above in axes]

    @property
    def locked(self) -> bool:
        """It stands still until it is unlocked or reset."""
        return self.killed or self._alarm

    def turn(self, seconds: float) -> None:
        """Read waiting commands, and move on for this long."""
        self._hear(self.port.read(0.0))
        self._advance(seconds * self._speed)
        if self._homing and not self._moves:
            self._homing, self._from_above = False, [False] * 3
            self._say("ok")
        self._cleaning_s = max(0.0, self._cleaning_s - seconds)
        while self._held and not self._moves and not self._cleaning_s:
            self._marlin(self._held.popleft())

    def _hear(self, data: bytes) -> None:
        for byte in data:
            if self._grbl and byte in b"?\x85\x18!~":
                self._realtime(byte)
            elif byte in b"\r\n":
                line, self._rest = self._rest.decode(), b""
                if line and not self.killed and not self.deaf and not self._awaits_reset:
                    self.received.append(line)
                    self._obey(line)
            else:
                self._rest += bytes([byte])

    def _obey(self, line: str) -> None:
        if self._grbl:
            self._grbl_line(line)
        elif line == "M112":
            self._kill()
        elif line == "M410":  # the emergency parser handles it immediately
            self._moves.clear()
            self._cleaning_s = CLEANING_S
            self._say("ok")
        elif self._held or self._homing or (line in ("M400", "M114", "G28") and (self._moves or self._cleaning_s)):
            self._held.append(line)
        else:
            self._marlin(line)

    def _marlin(self, line: str) -> None:
        if line == "M114":
            x, y, z = self._told
            self._say(f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 Count X:{x * 80:.0f} Y:{y * 80:.0f} Z:{z * 400:.0f}")
        elif line == "G28":
            self._home()
            return
        elif line in ("G90", "G91"):
            self._relative = line == "G91"
        elif line.startswith("G1 "):
            self._queue(line, self._relative)
        elif not re.match(r"(G21|M211 S1|M400)$", line):
            self._say(f'echo:Unknown command: "{line}"')
        self._say("ok")

    def _grbl_line(self, line: str) -> None:
        if line == "$X":
            self._alarm = False
            self._say("[MSG:Caution: Unlocked]")
        elif self._alarm:
            self._say("error:9")
            return
        elif line == "$H":
            self._home()
            return
        elif line.startswith("$J="):
            if self._moves:
                self._say("error:8")  # stricter than GRBL, which would queue it
                return
            self._queue(line, "G91" in line)
        elif line not in ("G21", "G90", "$10=1"):
            self._say("error:20")
            return
        self._say("ok")

    def _realtime(self, byte: int) -> None:
        if self.deaf or (self._awaits_reset and byte != 0x18):
            return
        if byte == ord("?"):
            state = "Alarm" if self._alarm else "Home" if self._homing else "Jog" if self._moves else "Idle"
            x, y, z = self._told
            self._say(f"<{state}|MPos:{x:.3f},{y:.3f},{z:.3f}|FS:0,0>")
        elif byte == 0x85:
            self._moves.clear()
        elif byte == 0x18:
            self._reset()

    def lose_power(self) -> None:
        """Off for a moment: its position then counts as zero, and GRBL must be homed first."""
        self._moves.clear()
        self._held.clear()
        self._zero = [zero + told for zero, told in zip(self._zero, self._told, strict=True)]
        self._told = [0.0, 0.0, 0.0]
        self._alarm = self._grbl
        self.__enter__()

    def _reset(self) -> None:
        """GRBL's soft reset: an alarm stays, and an interrupted move causes one. The position is kept."""
        if self._moves:
            self._alarm = True
            self._say("ALARM:3")
        self._moves.clear()
        self._awaits_reset = self._homing = False
        self._rest = b""
        self._say("Grbl 1.1h ['$' for help]")
        if self._alarm:
            self._say("[MSG:'$H'|'$X' to unlock]")

    def _home(self) -> None:
        if self.homing_mm_per_s is None:
            self._told = list(self.home)
        else:
            self._moves.append(Move(list(self.home), self.homing_mm_per_s))
        self._homing = True

    def _queue(self, line: str, relative: bool) -> None:
        if self._cleaning_s:
            return
        words = dict(re.findall(r"([XYZF])(-?[\d.]+)", line))
        start = self._moves[-1].target if self._moves else self._told
        target = [
            (start[i] if relative or axis not in words else 0.0) + float(words.get(axis, 0.0))
            for i, axis in enumerate("XYZ")
        ]
        mm_per_s, along_z_mm = float(words["F"]) / 60.0, abs(target[2] - start[2])
        if along_z_mm:
            mm_per_s = min(mm_per_s, self._z_limit_mm_per_s * math.dist(target, start) / along_z_mm)
        self._moves.append(Move(target, mm_per_s))

    def _kill(self) -> None:
        self._moves.clear()
        self._held.clear()
        self._homing = False
        self.killed = True
        self._say("Error:Printer halted. kill() called!")

    def _advance(self, seconds: float) -> None:
        while seconds > 0.0 and self._moves and not self.stalled:
            move = self._moves[0]
            way = [target - told for target, told in zip(move.target, self._told, strict=True)]
            distance = math.hypot(*way)
            share = min(1.0, move.mm_per_s * seconds / distance) if distance > 0.0 else 1.0
            seconds = seconds - distance / move.mm_per_s if share == 1.0 else 0.0
            self._told = [told + share * step for told, step in zip(self._told, way, strict=True)]
            self._from_above = [
                step < 0.0 if abs(step) > 1e-9 else above for step, above in zip(way, self._from_above, strict=True)
            ]
            if share == 1.0:
                self._moves.popleft()
            self._switch(way[2])
        self.on_moved(self.place)

    def _switch(self, upward: float) -> None:
        if self.switch_mm is None or upward >= 0.0 or self._told[2] > self.switch_mm:
            return
        self._moves.clear()
        self._held.clear()
        if self._grbl:
            self._alarm = self._awaits_reset = True
            self._say("ALARM:1")
            self._say("[MSG:Reset to continue]")
        else:
            self._say("echo:endstops hit:  Z:" + f"{self._told[2]:.2f}")

    def _say(self, line: str) -> None:
        if not self.deaf:
            self.port.write(line.encode() + b"\r\n")
