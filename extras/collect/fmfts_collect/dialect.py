"""Makes the commands and reads the answers of the two dialects of G-code that hobby machines use.

Marlin: https://marlinfw.org/meta/gcode/ (M112, M114, M211, M400, M410). After M410 it drops every move for a second
(planner.cpp, quick_stop: cleaning_buffer_counter), and M400 waits until that second has passed. GRBL 1.1:
https://github.com/gnea/grbl/wiki, "Grbl v1.1 Interface", "Jogging" (moves are jogs: 0x85 ends them at once, and the
position is kept). After ALARM:1 and ALARM:2 it accepts nothing but 0x18 (protocol.c, "Reset to continue").
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Protocol

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Answer:
    """Content of one line from the machine. ok: it accepted a command (Marlin: carried it out). place: its position.

    standing: whether it stands still; None where the line does not tell. trouble: the machine's text why it does not
    go on. started: it was reset.
    """

    ok: bool = False
    place: Place | None = None
    standing: bool | None = None
    trouble: str = ""
    started: bool = False


class Dialect(Protocol):
    """Commands of a dialect. `settle` is sent once after each move; `ask` is repeated until an answer is `standing`."""

    set_up: tuple[str, ...]
    home: tuple[str, ...]  # z goes up first: the rod may stand on the pad
    settle: tuple[str, ...]
    ask: bytes
    halt: bytes  # ends motion at once and keeps the position
    halt_s: float  # time after a halt in which the machine accepts no move
    reset: bytes  # makes it accept commands after an alarm; keeps the position. b"": not needed
    emergency: bytes  # stops everything; the machine must be reset by hand
    unlock: tuple[str, ...]  # sent after an alarm, before the next move

    def move(self, place: Place, mm_per_s: float) -> str:
        """The line for a straight move to `place` in machine coordinates."""

    def rise(self, z_mm: float, mm_per_s: float) -> tuple[str, ...]:
        """The lines for a straight move up to that height, also after a halt."""

    def rise_by(self, way_mm: float, mm_per_s: float) -> tuple[str, ...]:
        """The lines for a straight move up by this distance, for a machine that does not know its position."""

    def read(self, line: str) -> Answer:
        """The content of a line from the machine."""


GRBL_TROUBLES = {
    "error:8": "not idle",
    "error:9": "locked: it has an alarm",
    "error:15": "the jog goes beyond its own soft limits",
    "ALARM:1": "a limit switch was hit",
    "ALARM:2": "a soft limit was reached",
    "ALARM:3": "it was reset while it moved",
    "ALARM:8": "homing failed: the switch was not left",
    "ALARM:9": "homing failed: no switch was found",
}


class Marlin:
    set_up: tuple[str, ...] = ("G21", "G90", "M211 S1")  # millimetres, absolute, soft limits on
    home: tuple[str, ...] = ("G91", "G1 Z5 F240", "G90", "G28")
    settle: tuple[str, ...] = ("M400", "M114")
    ask = b""
    halt = b"M410\n"
    halt_s = 1.0
    reset = b""
    emergency = b"M112\n"
    unlock: tuple[str, ...] = ()

    _PLACE = re.compile(r"^X:\s*(-?[\d.]+) Y:\s*(-?[\d.]+) Z:\s*(-?[\d.]+)")
    _TROUBLE = re.compile(r"^(Error:.*|echo:\s*endstops hit:.*|!!.*|.*(?:kill|KILL|halted).*)")

    def move(self, place: Place, mm_per_s: float) -> str:
        x, y, z = place
        return f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} F{mm_per_s * 60:.1f}"

    def rise(self, z_mm: float, mm_per_s: float) -> tuple[str, ...]:
        return ("M400", "G90", f"G1 Z{z_mm:.4f} F{mm_per_s * 60:.1f}")

    def rise_by(self, way_mm: float, mm_per_s: float) -> tuple[str, ...]:
        return ("G91", f"G1 Z{way_mm:.4f} F{mm_per_s * 60:.1f}", "G90")

    def read(self, line: str) -> Answer:
        if line.startswith("ok"):
            return Answer(ok=True)
        if match := self._PLACE.match(line):
            # This answers M114, which is sent after M400: the machine stands still.
            return Answer(place=(float(match[1]), float(match[2]), float(match[3])), standing=True)
        if line == "start":
            return Answer(started=True)
        return Answer(trouble=line if self._TROUBLE.match(line) else "")


class Grbl:
    set_up: tuple[str, ...] = ("G21", "G90", "$10=1")  # millimetres, absolute, reports in machine positions
    home: tuple[str, ...] = ("$H",)  # homes z first: HOMING_CYCLE_0
    settle: tuple[str, ...] = ()
    ask = b"?"
    halt = b"\x85"
    halt_s = 0.0
    reset = b"\x18"
    emergency = b"\x18"
    unlock: tuple[str, ...] = ("$X",)

    _STATE = re.compile(r"^<(\w+)(?::\d)?\|MPos:(-?[\d.]+),(-?[\d.]+),(-?[\d.]+)")

    def move(self, place: Place, mm_per_s: float) -> str:
        x, y, z = place
        return f"$J=G53 X{x:.4f} Y{y:.4f} Z{z:.4f} F{mm_per_s * 60:.1f}"

    def rise(self, z_mm: float, mm_per_s: float) -> tuple[str, ...]:
        return (f"$J=G53 Z{z_mm:.4f} F{mm_per_s * 60:.1f}",)

    def rise_by(self, way_mm: float, mm_per_s: float) -> tuple[str, ...]:
        return (f"$J=G91 Z{way_mm:.4f} F{mm_per_s * 60:.1f}",)

    def read(self, line: str) -> Answer:
        if line == "ok":
            return Answer(ok=True)
        if match := self._STATE.match(line):
            place = (float(match[2]), float(match[3]), float(match[4]))
            trouble = "it is in alarm" if match[1] == "Alarm" else ""
            return Answer(place=place, standing=match[1] not in ("Jog", "Run", "Home"), trouble=trouble)
        if line.startswith(("error:", "ALARM:")):
            return Answer(trouble=f"{line} ({GRBL_TROUBLES.get(line, 'see the wiki of GRBL')})")
        return Answer(started=line.startswith("Grbl "))


DIALECTS: dict[str, Dialect] = {"marlin": Marlin(), "grbl": Grbl()}
