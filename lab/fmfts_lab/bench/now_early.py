"""A pad whose samples also come one by one, before their frames: `bench now --samples`, in the world of the frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts.pipeline.configured import HOST_S, READ_S
from fmfts.sensor.early import EarlySample
from fmfts.sensor.frame import WireFrame
from fmfts.sensor.wire.packets import EARLY_BYTES, LINE_BITS_PER_BYTE, frame_bytes
from fmfts_lab.bench.drills import RATE_HZ
from fmfts_lab.bench.tapped import ManyFrames, wire_frames

Sent = EarlySample | WireFrame


class EarlyToo(ManyFrames):
    """Makes a board's packets in the order in which it sends them, on a line of `baud`."""

    def __init__(self, config: PadConfig, baud: int) -> None:
        super().__init__(config)
        self._byte_s = LINE_BITS_PER_BYTE / baud

    def sent(self, seconds: float) -> Iterator[tuple[float, Sent]]:
        """Each packet with the time at which its message is published."""
        first = self._chips.newest_conversion(0.0) - 1
        count = int(seconds * RATE_HZ * 1.05) + 3
        sampled_s = self._chips.time_of(first + np.arange(count)[:, None])
        counts = self._chips.counts(self._fields(sampled_s), self._gain_code, 0.0)
        frames = self._frames(round(seconds * RATE_HZ), first, sampled_s, counts)
        ready: list[tuple[float, Sent]] = [(number / RATE_HZ, frame) for number, frame in enumerate(frames)]
        for conversion, sensor in np.ndindex(sampled_s.shape):
            ended_s = float(sampled_s[conversion, sensor])
            read_s, time_us = ended_s + READ_S, round(ended_s * 1e6)
            if time_us >= 0 and read_s < seconds:
                x, y, z = counts[conversion, sensor].tolist()
                ready.append((read_s, EarlySample(0, sensor, time_us, self._gain_code, (x, y, z))))
        return self._on_the_line(sorted(ready, key=lambda one: one[0]), len(first))

    def _frames(
        self, count: int, first: NDArray[np.int64], sampled_s: Array, counts: NDArray[np.int16]
    ) -> list[WireFrame]:
        """The frames whose samples were read when they are made."""
        sequence = np.arange(count)
        newest = self._chips.newest_conversion(sequence[:, None] / RATE_HZ - READ_S) - first
        fresh = newest != np.concatenate([newest[:1] - 1, newest[:-1]])
        taken_s = np.take_along_axis(sampled_s, newest, axis=0)
        taken = np.take_along_axis(counts, newest[:, :, None], axis=0)
        self._start_ns = 0
        return wire_frames(sequence, taken_s, fresh, taken, self._gain_code)

    def _on_the_line(self, ready: list[tuple[float, Sent]], sensors: int) -> Iterator[tuple[float, Sent]]:
        free_s = 0.0
        for ready_s, packet in ready:
            size = EARLY_BYTES if isinstance(packet, EarlySample) else frame_bytes(sensors)
            free_s = max(free_s, ready_s) + size * self._byte_s
            yield free_s + HOST_S, packet
