"""A plug-in source that breaks every rule: it raises anything anywhere, and returns anything."""

from __future__ import annotations

import asyncio
import errno
import os
import struct
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import repeat
from random import Random
from typing import Any

import numpy as np
import zmq

from fmfts.config import PadConfig
from fmfts.sensor import Frame, SourceError, SourceState
from fmfts.sensor.early import EarlySample
from fmfts.sensor.patience import Patience
from fmfts.sensor.wire.clock import DeviceClock
from fmfts_simulation.source import Simulated


class UnprintableError(Exception):
    """An error whose text raises an error."""

    def __str__(self) -> str:
        raise ValueError("no text")


def _recurse() -> None:
    _recurse()


def raising(error: BaseException) -> Callable[[], None]:
    def fail() -> None:
        raise error

    return fail


ERRORS: dict[str, Callable[[], None]] = {
    "ValueError": raising(ValueError("bad value")),
    "TypeError": raising(TypeError("bad type")),
    "KeyError": raising(KeyError("missing")),
    "IndexError": raising(IndexError(7)),
    "AttributeError": raising(AttributeError("gone")),
    "AssertionError": raising(AssertionError()),
    "ZeroDivisionError": raising(ZeroDivisionError("division by zero")),
    "OverflowError": raising(OverflowError("too large")),
    "RecursionError": _recurse,
    "MemoryError": raising(MemoryError()),
    "OSError": raising(OSError(errno.EIO, "input/output error")),
    "PermissionError": raising(PermissionError(errno.EACCES, "not permitted")),
    "BrokenPipeError": raising(BrokenPipeError(errno.EPIPE, "broken pipe")),
    "TimeoutError": raising(TimeoutError("no answer")),
    "UnicodeDecodeError": raising(UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")),
    "struct.error": raising(struct.error("unpack requires 8 bytes")),
    "StopIteration": raising(StopIteration()),
    "zmq.ZMQError": raising(zmq.ZMQError(errno.ENOTSOCK)),
    "SourceError": raising(SourceError("the device is on fire: put it out")),
    "SystemExit": raising(SystemExit(3)),
    "GeneratorExit": raising(GeneratorExit()),
    "CancelledError": raising(asyncio.CancelledError()),
    "UnprintableError": raising(UnprintableError()),
    "surrogates": raising(RuntimeError("\udcff\udcfe" * 300)),
}
if sys.version_info >= (3, 11):
    ERRORS["ExceptionGroup"] = raising(ExceptionGroup("several", [ValueError("one"), OSError("two")]))  # noqa: F821


def frames_with(**changes: Any) -> Callable[[Sequence[Frame]], object]:
    return lambda frames: [replace(frame, **changes) for frame in frames]


def _many(frames: Sequence[Frame]) -> object:
    return [replace(frame, sequence=frame.sequence * 2_000 + n) for frame in frames for n in range(2_000)]


def _many_fresh(frames: Sequence[Frame]) -> object:
    return [
        replace(
            frame,
            sequence=frame.sequence * 2_000 + n,
            device_time_us=frame.device_time_us + n,
            host_time_ns=frame.host_time_ns + 1_000 * n,
        )
        for frame in frames
        for n in range(2_000)
    ]


def _endless(frames: Sequence[Frame]) -> Iterator[Frame]:
    return (frame for again in repeat(frames) for frame in again)


FRAMES: dict[str, Callable[[Sequence[Frame]], object]] = {
    "None": lambda frames: None,
    "no frames": lambda frames: ["frame"],
    "endless": _endless,
    "2,000 a poll": _many,
    "2,000 fresh a poll": _many_fresh,
    "another pad's": frames_with(pad_index=5),
    "pad_index []": frames_with(pad_index=[]),
    "3 sensors": lambda frames: [replace(frame, counts=frame.counts[:3]) for frame in frames],
    "counts NaN": lambda frames: [replace(frame, counts=np.full(frame.counts.shape, np.nan)) for frame in frames],
    "ages missing": frames_with(age_us=None),
    "temperature NaN": frames_with(temperature_c=float("nan")),
    "temperature inf": frames_with(temperature_c=float("inf")),
    "time negative": frames_with(device_time_us=-1, host_time_ns=-1),
    "time None": frames_with(device_time_us=None),
    "time 2**80": frames_with(device_time_us=1 << 80),
    "time 2**53": frames_with(device_time_us=1 << 53),
    "time in an hour": lambda frames: [
        replace(frame, host_time_ns=frame.host_time_ns + 3600 * 10**9) for frame in frames
    ],
    "gain_code 99": frames_with(gain_code=99),
    "sequence -1": frames_with(sequence=-1),
    "chip None": frames_with(chip=None),
}
NUMBERS: dict[str, object] = {"NaN": float("nan"), "text": "soon", "2**80": 1 << 80, "-2**80": -(1 << 80), "always": 0}
DESCRIPTORS: dict[str, object] = {"-1": -1, "9999": 9999, "text": "stdin"}
CLOCK_LINES: dict[str, object] = {"None": None, "short": bytearray(8), "read-only": bytes(DeviceClock().line)}
LENDABLE: dict[str, object] = {"5": 5, "None": None, "text": "all", "another pad's": frozenset((5,))}
LENT: dict[str, Callable[[int], object]] = {
    "None": lambda descriptor: None,
    "no pair": lambda descriptor: (descriptor,),
    "-1": lambda descriptor: (-1, b""),
    "9999": lambda descriptor: (9999, b""),
    "2**80": lambda descriptor: (1 << 80, b""),
    "text": lambda descriptor: (descriptor, "text"),
    "too long": lambda descriptor: (descriptor, bytes(1 << 20)),
}
KINDS = (
    *(("raises", kind) for kind in ERRORS),
    *(("frames", kind) for kind in FRAMES),
    *(("deadline", kind) for kind in NUMBERS),
    *(("descriptor", kind) for kind in DESCRIPTORS),
    *(("clock_line", kind) for kind in CLOCK_LINES),
    *(("lendable", kind) for kind in LENDABLE),
    *(("lend", kind) for kind in LENT),
)
# The pad may stay "ok".
HARMLESS = {
    *(("deadline", kind) for kind in ("2**80", "-2**80", "always")),
    *(("frames", kind) for kind in ("2,000 a poll", "2,000 fresh a poll")),
}


class Faulty:
    """A ByteSource: a simulated pad with the fault of `fault`, at random places. It lends an empty pipe.

    fault(): a kind of KINDS, None while the source works.
    """

    def __init__(
        self, config: PadConfig, fault: Callable[[], tuple[str, str] | None], chance: Random, often: float
    ) -> None:
        """often: probability of an error at each place where one may occur."""
        self._simulated, self._fault, self._chance, self._often = Simulated(config), fault, chance, often
        self._clock_line = DeviceClock().line
        self._patience: Patience | None = None
        self._meet(0.5)
        self._pipe: tuple[int, ...] = os.pipe()

    @property
    def state(self) -> SourceState:
        return self._simulated.state

    @property
    def patience(self) -> Patience | None:
        return self._patience

    @patience.setter
    def patience(self, patience: Patience | None) -> None:
        self._meet()
        self._patience = patience

    @property
    def clock_line(self) -> Any:
        self._meet()
        return self._instead("clock_line", CLOCK_LINES, self._clock_line)

    def fileno(self) -> Any:
        self._meet()
        return self._instead("descriptor", DESCRIPTORS, self._pipe[0])

    def deadline_ns(self) -> Any:
        self._meet()
        return self._instead("deadline", NUMBERS, self._simulated.deadline_ns())

    def poll(self, now_ns: int) -> Any:
        self._meet()
        frames = self._simulated.poll(now_ns)
        fault = self._fault()
        return FRAMES[fault[1]](frames) if fault is not None and fault[0] == "frames" else frames

    def take_early(self) -> Sequence[tuple[int, EarlySample]]:
        self._meet()
        return ()

    def lendable(self) -> Any:
        self._meet()
        return self._instead("lendable", LENDABLE, frozenset((0,)))

    def lend(self) -> Any:
        self._meet()
        fault = self._fault()
        return LENT[fault[1]](self._pipe[0]) if fault is not None and fault[0] == "lend" else (self._pipe[0], b"")

    def give_back(self, unread: bytes, heard_ns: int, left_out: Sequence[int]) -> None:
        self._meet()

    def passed(self, pad_index: int, sequence: int) -> None:
        raise AssertionError("nothing came through the pipe")

    def request_selftest(self, pad_index: int) -> None:
        self._meet(1.0)

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return None

    def close(self) -> None:
        descriptors, self._pipe = self._pipe, ()
        for descriptor in descriptors:
            os.close(descriptor)
        self._meet(0.5)

    def _meet(self, often: float | None = None) -> None:
        """Raise here with that probability."""
        fault = self._fault()
        often = self._often if often is None else often
        if fault is not None and fault[0] == "raises" and self._chance.random() < often:
            ERRORS[fault[1]]()

    def _instead(self, what: str, choice: dict[str, object], otherwise: object) -> object:
        fault = self._fault()
        return choice[fault[1]] if fault is not None and fault[0] == what else otherwise
