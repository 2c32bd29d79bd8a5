"""Faults of a board's chips and line, frame by frame; and faults of the computer."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import Sample

if TYPE_CHECKING:
    from drills.chaos.board import ChaosBoard

REPEATED = 220  # frames: what is repeated is a second old
ChipFault = Callable[[Sample, Sample, random.Random], Sample]
LineFault = Callable[["ChaosBoard", Sample, bytes, random.Random], tuple[bytes, bool]]


def _stale(now: Sample, old: Sample, dice: random.Random) -> Sample:
    """No chip gives a new sample, and the board does not notice."""
    return replace(now, counts=old.counts, fresh=0)


def _frozen(now: Sample, old: Sample, dice: random.Random) -> Sample:
    """The same, and the board's clock stands still."""
    return replace(now, counts=old.counts, fresh=0, time_us=old.time_us)


def _hot(now: Sample, old: Sample, dice: random.Random) -> Sample:
    return replace(now, temperature_raw=dice.choice((32767, -32767, 8000, -8000)))


def _swapped(now: Sample, old: Sample, dice: random.Random) -> Sample:
    """The wires of sensors 1 and 2 are exchanged."""
    return replace(now, counts=now.counts[[1, 0, 2, 3]])


def _silent(now: Sample, old: Sample, dice: random.Random) -> Sample:
    return replace(now, valid=now.valid & ~0b0100, fresh=now.fresh & ~0b0100)


def _saturated(now: Sample, old: Sample, dice: random.Random) -> Sample:
    counts = now.counts.copy()
    counts[3, 2] = -4096
    return replace(now, counts=counts)


def _impossible(now: Sample, old: Sample, dice: random.Random) -> Sample:
    counts = now.counts.copy()
    counts[1, 0] = dice.choice((2048, 30000, -2049, -32768))
    return replace(now, counts=counts)


def _stuck(now: Sample, old: Sample, dice: random.Random) -> Sample:
    counts = now.counts.copy()
    counts[0] = old.counts[0]
    return replace(now, counts=counts)


def _step(now: Sample, old: Sample, dice: random.Random) -> Sample:
    """One axis is half a gauss off."""
    counts = now.counts.copy()
    counts[2, 0] = np.clip(int(counts[2, 0]) + 330, -2048, 2047)
    return replace(now, counts=counts)


def _browned_out(now: Sample, old: Sample, dice: random.Random) -> Sample:
    """The supply of one sensor failed for a moment: its gain is that of power-on, 1090 counts a gauss, not 660."""
    counts = now.counts.copy()
    counts[1] = np.clip(np.rint(counts[1] * (1090 / 660)), -2048, 2047).astype(np.int16)
    return replace(now, counts=counts)


def _flipped(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    spoilt = bytearray(line)
    for _ in range(dice.randrange(1, 4)):
        spoilt[dice.randrange(len(spoilt))] ^= 1 << dice.randrange(8)
    return bytes(spoilt), False


def _cut(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    return line[: dice.randrange(1, len(line))], False


def _garbage(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    return dice.randbytes(dice.randrange(1, 60)) + b"\0" + line, True


def _doubled(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    board.again += 1
    return line + line, True


def _again(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    """Some packets of a second ago are repeated."""
    return (line + b"".join(board.lines_ago(dice.randrange(1, 12))) if dice.random() < 0.1 else line), True


def _future(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    """Some valid packets carry an impossible time or number."""
    if dice.random() > 0.05:
        return line, True
    other = replace(sample, time_us=min(sample.time_us + 2 ** dice.randrange(20, 48), 2**48 - 1))
    if dice.random() < 0.5:
        other = replace(sample, sequence=(sample.sequence + 2 ** dice.randrange(17, 32)) % 2**32)
    return encode(other), False


def _tripled(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    board.again += 2
    return 3 * line, True


def _burst(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    """The last few packets are repeated unchanged."""
    if dice.random() >= 0.3:
        return line, True
    burst = [*board.lines_ago(REPEATED)[-3:], line]
    board.again += len(burst)
    return line + b"".join(burst), True


def _swapped_lines(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    """Each second packet overtakes the one before it."""
    if not board.held_back:
        board.held_back = line
        return b"", True
    before, board.held_back = board.held_back, b""
    board.overtaken += 1
    return line + before, True


def _mute(board: ChaosBoard, sample: Sample, line: bytes, dice: random.Random) -> tuple[bytes, bool]:
    return b"", False


CHIPS: dict[str, ChipFault] = {
    "stale": _stale, "frozen": _frozen, "hot": _hot, "swapped": _swapped, "silent": _silent, "saturated": _saturated,
    "impossible": _impossible, "stuck": _stuck, "step": _step, "browned out": _browned_out,
}  # fmt: skip
# Faults of a single chip, and which chip; the last three give false samples, the others give none.
OF_ONE_CHIP = {"silent": 2, "saturated": 3, "impossible": 1, "browned out": 1, "step": 2, "stuck": 0}
LYING = {"browned out", "step", "stuck"}
LINES: dict[str, LineFault] = {
    "flipped": _flipped, "cut": _cut, "garbage": _garbage, "doubled": _doubled, "again": _again, "future": _future,
    "mute": _mute,
}  # fmt: skip
# The same lines repeated or in another order.
ORDERS: dict[str, LineFault] = {
    "doubled": _doubled, "tripled": _tripled, "burst": _burst, "swapped lines": _swapped_lines,
}  # fmt: skip
# Made by the drill itself: it unplugs or resets a board, or pulls a magnet.
OTHERS = ("lifted", "replug", "reset", "reset unheard")
# Of the whole computer: they affect all pads.
GLOBAL = ("load", "stopped", "strangers", "requests", "deaf")
