"""`now` while a sensor begins to fail: is it published where it is wrong? The drills are those of `bench faults`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from fmfts.bus.messages import ContactMessage
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts_lab.bench.drills import FINGERS, pad_config
from fmfts_lab.bench.fault_kinds import Fault, sensor_faults
from fmfts_lab.bench.faults import AMBIENTS, Healthy

FRAMES = 60  # after the fault began; by then the daemon has named it
WRONG_N, WRONG_DEVIATIONS = 0.15, 5.0
HEADER = "fault               drills  frames  null %  wrong  largest error, N"


@dataclass(slots=True)
class Told:
    """wrong: frames off by more than WRONG_N and WRONG_DEVIATIONS. largest_n: of all errors of force."""

    kind: str
    drills: int = 0
    frames: int = 0
    null: int = 0
    wrong: int = 0
    largest_n: float = 0.0

    @property
    def line(self) -> str:
        null = 100 * self.null / self.frames
        return f"{self.kind:18} {self.drills:7d} {self.frames:7d} {null:7.1f} {self.wrong:6d} {self.largest_n:9.3f}"


def drilled(seeds: Iterable[int], early: bool = False) -> list[Told]:
    """Every fault of every sensor and axis, in both scenes, on a pressed pad and on one at rest. early: samples as they
    come, too."""
    told: dict[str, Told] = {}
    for seed in seeds:
        model = load_contact_model(pad_config("constant", seed))
        for ambient in AMBIENTS:
            for touch in FINGERS:
                healthy = Healthy(ambient, touch, seed, model)
                for fault in sensor_faults(range(4), range(3)):
                    _drill(healthy, fault, told.setdefault(fault.kind, Told(fault.kind)), early)
    return list(told.values())


def _drill(healthy: Healthy, fault: Fault, told: Told, early: bool) -> None:
    pipeline, frames = healthy.pipeline(), healthy.frames_with(fault)
    told.drills += 1
    for message in _messages(pipeline, frames[healthy.begin : healthy.begin + FRAMES], early):
        now = message.now
        told.frames += 1
        if now is None:
            told.null += 1
            continue
        error_n = abs(now.force_n - healthy.finger(now.t_ns * 1e-9).force_n)
        told.largest_n = max(told.largest_n, error_n)
        told.wrong += error_n > WRONG_N and error_n > WRONG_DEVIATIONS * now.force_sd_n


def _messages(pipeline: PadPipeline, frames: Iterable[Frame], early: bool) -> Iterator[ContactMessage]:
    for frame in frames:
        for sample in samples_of(frame) if early else ():
            answer = pipeline.early(sample)
            if answer is not None:
                yield message_of(answer)
        yield pipeline.process(frame)


def samples_of(frame: Frame) -> list[EarlySample]:
    """The frame's new samples, as a board sends them before it."""
    new = np.flatnonzero(frame.fresh & frame.valid).tolist()
    return [
        EarlySample(0, sensor, int(frame.sampled_us[sensor]), frame.gain_code, _axes(frame, sensor), frame.chip)
        for sensor in sorted(new, key=lambda sensor: int(frame.sampled_us[sensor]))
    ]


def _axes(frame: Frame, sensor: int) -> tuple[int, int, int]:
    x, y, z = frame.counts[sensor].tolist()
    return x, y, z
