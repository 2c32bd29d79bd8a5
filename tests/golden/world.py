"""Frozen worlds: the raw frames of one to three pads, with the configuration and the baseline of each.

Counts are stored as a simulated pad's without noise, which compress well; noise and faults are added from whole numbers
when a world is read. Recordings of `record` are stored with their noise. `digest` is of the decoded frames, so that a
machine that reads other frames reports it.
"""

from __future__ import annotations

import hashlib
import heapq
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fmfts.config import PadConfig
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.early import EarlySample
from golden.coding import compressed, expanded, packed, unpacked
from golden.faults import Stream, apply
from golden.noise import noise

FOLDER = Path(__file__).parent / "data"
# How often each row of a stream is differentiated: clocks run evenly, fields change smoothly.
DIFFERENCES = {
    "sequence": 2, "device_time_us": 2, "host_time_ns": 2, "counts": 1, "age_us": 2, "fresh": 1, "valid": 1,
    "temperature": 1,
}  # fmt: skip
Event = Frame | EarlySample


@dataclass(slots=True)
class WorldPad:
    """noise: deviation in thousandths of a count; faults: see faults.py. is_early: each sample also comes before its
    frame; comes_again: and once more after it. baseline: the content of its file; None: there is none. response: the
    file of a skin's contact model."""

    config: dict[str, Any]
    baseline: dict[str, Any] | None
    gain_code: int
    temperatures_c: list[float]
    stream: Stream
    noise: int = 0
    seed: int = 0
    faults: list[list[Any]] = field(default_factory=list)
    is_early: bool = False
    comes_again: bool = False
    response: bytes | None = None

    @property
    def settings(self) -> PadConfig:
        return msgspec.convert(self.config, PadConfig)

    def events(self) -> Iterator[tuple[int, list[Event]]]:
        """Yields each arrival with its index in the order of the pad's frames."""
        stream, chip = self.read(), CHIPS[self.settings.source.chip]
        arrive = apply(stream, self.faults, chip.largest_count, chip.saturated_count)
        for number in np.flatnonzero(arrive).tolist():
            temperature = int(stream.temperature[number])
            frame = Frame(
                pad_index=0,
                sequence=int(stream.sequence[number]),
                device_time_us=int(stream.device_time_us[number]),
                host_time_ns=int(stream.host_time_ns[number]),
                gain_code=self.gain_code,
                counts=stream.counts[number].astype(np.int16),
                age_us=stream.age_us[number].astype(np.uint16),
                fresh=stream.fresh[number].astype(np.bool_),
                valid=stream.valid[number].astype(np.bool_),
                temperature_c=None if temperature < 0 else self.temperatures_c[temperature],
                chip=chip,
            )
            early = [*self._early(frame)] if self.is_early else []
            yield number, [*early, frame, *(early if self.comes_again and number else ())]

    def read(self) -> Stream:
        """The stream with its noise. A sample that is not fresh repeats the last one."""
        copy = Stream(*(getattr(self.stream, name).copy() for name in DIFFERENCES))
        if self.noise:
            frames, *shape = copy.counts.shape
            drawn = noise(self.seed, frames, int(np.prod(shape)), self.noise).reshape(copy.counts.shape)
            newest = np.where(copy.fresh > 0, np.arange(frames)[:, None], 0)
            newest = np.maximum.accumulate(newest, axis=0)
            copy.counts += np.take_along_axis(drawn, newest[:, :, None], axis=0)
        return copy

    def _early(self, frame: Frame) -> Iterator[EarlySample]:
        """All fresh samples but the newest, with which the frame comes."""
        for sensor in np.argsort(-frame.age_us.astype(int), kind="stable").tolist():
            if frame.fresh[sensor] and frame.valid[sensor] and frame.age_us[sensor] > 0:
                x, y, z = frame.counts[sensor].tolist()
                time_us = frame.device_time_us - int(frame.age_us[sensor])
                yield EarlySample(0, sensor, time_us, frame.gain_code, (x, y, z), frame.chip)


@dataclass(slots=True)
class World:
    """Pads whose frames come in turn: the first frame of each, then the second of each."""

    name: str
    pads: list[WorldPad]

    def events(self) -> Iterator[tuple[str, Event]]:
        """Yields each arrival with the name of its pad."""
        own = [_placed(place, pad) for place, pad in enumerate(self.pads)]
        for _, _, name, events in heapq.merge(*own, key=lambda one: one[:2]):
            for event in events:
                yield name, event

    @property
    def frames(self) -> int:
        return sum(len(pad.stream.sequence) for pad in self.pads)

    @property
    def digest(self) -> str:
        digest = hashlib.sha256()
        for name, event in self.events():
            digest.update(f"{name} {event.device_time_us} {event.gain_code}".encode())
            if isinstance(event, EarlySample):
                digest.update(f"{event.sensor} {event.counts}".encode())
            else:
                digest.update(f"{event.sequence} {event.host_time_ns} {event.temperature_c}".encode())
                for array in (event.counts, event.age_us, event.fresh, event.valid):
                    digest.update(array.tobytes())
        return digest.hexdigest()

    def save(self) -> None:
        pads = [
            {
                **{name: getattr(pad, name) for name in WorldPad.__dataclass_fields__ if name != "stream"},
                "stream": {name: packed(getattr(pad.stream, name), order) for name, order in DIFFERENCES.items()},
            }
            for pad in self.pads
        ]
        (FOLDER / f"{self.name}.frames.xz").write_bytes(compressed({"digest": self.digest, "pads": pads}))


def _placed(place: int, pad: WorldPad) -> Iterator[tuple[int, int, str, list[Event]]]:
    name = pad.settings.name
    return ((number, place, name, events) for number, events in pad.events())


def load(name: str) -> tuple[World, str]:
    """The world, and the digest that its frames had when it was made."""
    content = expanded((FOLDER / f"{name}.frames.xz").read_bytes())
    pads = [
        WorldPad(**(each | {"stream": Stream(*(unpacked(each["stream"][one]) for one in DIFFERENCES))}))
        for each in content["pads"]
    ]
    return World(name, pads), content["digest"]


def names() -> list[str]:
    return sorted(path.name.removesuffix(".frames.xz") for path in FOLDER.glob("*.frames.xz"))
