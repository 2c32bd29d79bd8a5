"""Checks what a source returns. TypeError or ValueError if no source may return that."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.sensor.wire.clock import LINE_BYTES


def whole(number: int | None) -> int | None:
    if number is not None and type(number) is not int:
        raise TypeError(f"{number!r} is no whole number")
    return number


def frames_of(pads: Collection[int], frames: Sequence[Frame]) -> Sequence[Frame]:
    if not isinstance(frames, list | tuple):
        raise TypeError(f"a {type(frames).__name__} came instead of a sequence of frames")
    for frame in frames:
        if not isinstance(frame, Frame):
            raise TypeError(f"a {type(frame).__name__} came instead of a frame")
        if type(frame.pad_index) is not int or frame.pad_index not in pads:
            raise ValueError(f"a frame of pad_index {frame.pad_index!r} came, and no such pad is configured")
        if type(frame.device_time_us) is not int:
            raise TypeError(f"a frame's device_time_us is {frame.device_time_us!r}")
    return frames


def early(samples: Sequence[tuple[int, EarlySample]]) -> Sequence[tuple[int, EarlySample]]:
    if not isinstance(samples, list | tuple):
        raise TypeError(f"a {type(samples).__name__} came instead of a sequence of samples")
    for before, sample in samples:
        if type(before) is not int or not isinstance(sample, EarlySample) or type(sample.pad_index) is not int:
            raise TypeError(f"{before!r}, {sample!r} came instead of a sample")
    return samples


def clock_line(line: memoryview) -> memoryview:
    if not isinstance(line, memoryview) or line.readonly or line.nbytes != LINE_BYTES:
        raise TypeError(f"a {type(line).__name__} came instead of a memoryview of {LINE_BYTES} bytes to write to")
    return line


def lendable(pads: frozenset[int], lent: frozenset[int]) -> frozenset[int]:
    if not isinstance(lent, frozenset) or not lent <= pads:
        raise TypeError(f"{lent!r} came instead of a frozenset of the source's pads")
    return lent


def lent(descriptor: int | None, pair: tuple[int, bytes]) -> tuple[int, bytes]:
    """descriptor: the source's own, which the daemon waits for."""
    if not isinstance(pair, tuple) or len(pair) != 2 or not isinstance(pair[1], bytes):
        raise TypeError(f"a {type(pair).__name__} came instead of a descriptor and the bytes that were read from it")
    if type(pair[0]) is not int or pair[0] != descriptor:
        raise ValueError(f"the descriptor {pair[0]!r} came, and the daemon waits for {descriptor!r}")
    return pair
