"""How often does a healthy pad report a fault while it is tapped? False alarms per pad-hour, and availability."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import cos, pi

import numpy as np
from numpy.typing import NDArray

from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor.frame import READING_BYTES, WireFrame
from fmfts_lab.bench.drills import RATE_HZ, Ambient, pad_config
from fmfts_lab.bench.truth import WRONG_DEVIATIONS, Truth
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.finger import Touch, columns
from fmfts_simulation.source import ROOM_C, TURNING_AXIS, Simulated

TAP_S = 50e-3
BATCH_FRAMES = 5 * RATE_HZ


def tapping(time_s: float) -> Touch:
    """1 N taps of 50 ms, three a second."""
    within_s = time_s % (1.0 / 3.0) - 0.1
    return Touch(1e-3, 2e-3, 0.5 * (1.0 - cos(2 * pi * within_s / TAP_S)) if 0.0 < within_s < TAP_S else 0.0)


@dataclass(slots=True)
class Well:
    """The results for a healthy pad that is tapped. alarms: episodes, each a run of messages that are not ok."""

    ambient: str
    frames: int = 0
    not_ok: int = 0
    alarms: int = 0
    wrong: int = 0
    worst: float = 0.0

    @property
    def line(self) -> str:
        hours = self.frames / RATE_HZ / 3600.0
        return (
            f"healthy, tapped, {self.ambient:8} {hours:.2f} pad-hours, {self.alarms} false alarms "
            f"({self.alarms / hours:.2g} an hour), available {1 - self.not_ok / self.frames:.4%}, "
            f"{self.wrong} of {self.frames} wrong, worst {self.worst:.1f} deviations"
        )

    def saw(self, messages: list[ContactMessage], deviations: Array, was_ok: bool) -> None:
        """Count the next messages of a pad. was_ok: whether the message before them was ok."""
        alarmed = np.array([message.health != "ok" for message in messages])
        self.frames += len(messages)
        self.not_ok += int(alarmed.sum())
        self.alarms += int((alarmed & np.append(was_ok, ~alarmed[:-1])).sum())
        self.wrong += int((deviations > WRONG_DEVIATIONS).sum())
        self.worst = max(self.worst, float(deviations.max()))


def pipeline_of(config: PadConfig, model: ContactModel) -> PadPipeline:
    pipeline = without_baseline(config, model)
    pipeline.use(simulated_baseline(config))
    return pipeline


def without_baseline(config: PadConfig, model: ContactModel) -> PadPipeline:
    tracking = tracking_model_for(config.scene, config.magnet).tracking
    return PadPipeline(config.pad(), model, "bench", float(RATE_HZ), tracking)


def tapped(ambient: Ambient, seeds: Iterable[int], seconds: float) -> Well:
    """Run frames as a board sends them through the daemon's own path: in C while nothing is wrong."""
    well = Well(ambient)
    for seed in seeds:
        config = pad_config(ambient, seed)
        pipeline = pipeline_of(config, load_contact_model(config))
        source = ManyFrames(config)
        source.finger = tapping
        truth = Truth(source.built, tapping)
        was_ok = True
        for frames in source.batches(round(seconds * RATE_HZ)):
            answers = [pipeline.answer(frame) for frame in frames]
            messages = [message_of(answer) for answer in answers]
            well.saw(messages, truth.all_deviations(messages), was_ok)
            was_ok = messages[-1].health == "ok"
    return well


class ManyFrames(Simulated):
    """Makes the frames of many polls at once, in a tenth of the time. Without neighbours.

    warmed_k: of a batch. Only imperfect pads warm.
    """

    warmed_k = 0.0

    def batches(self, count: int) -> Iterator[list[WireFrame]]:
        self._start_ns = 0
        while self._sequence < count:
            yield self._batch(min(BATCH_FRAMES, count - self._sequence))

    def _batch(self, count: int) -> list[WireFrame]:
        sequence = self._sequence + np.arange(count)
        conversion = self._chips.newest_conversion(sequence[:, None] / self._rate_hz)
        fresh = conversion != np.concatenate([self._delivered[None], conversion[:-1]])
        sampled_s = self._chips.time_of(conversion)
        counts = self._chips.counts(self._fields(sampled_s), self._gain_code, self.warmed_k)
        # A value that is not fresh repeats its last reading.
        newest = np.maximum.accumulate(np.where(fresh, np.arange(count)[:, None] + 1, 0))
        counts = np.take_along_axis(np.concatenate([self._counts[None], counts]), newest[:, :, None], axis=0)
        if self._imperfections is not None:
            counts = self._imperfections.transferred(counts)
        self._sequence += count
        self._delivered, self._counts = conversion[-1], counts[-1]
        return wire_frames(sequence, sampled_s, fresh, counts, self._gain_code, self._told_c(self.warmed_k))

    def _fields(self, sampled_s: Array) -> Array:
        """(K, N, 3) field at each sensor of each frame, at its own sample time (K, N)."""
        if self._imperfections is not None:
            return self.imperfect_field(self._ambients(sampled_s), sampled_s, self.warmed_k)
        built, shape = self._built, (*sampled_s.shape, 3)
        press = columns([self.finger(moment) for moment in sampled_s.ravel().tolist()])
        position_m, axis = (vectors.reshape(shape) for vectors in built.pose(*press))
        magnet_t = cylinder_field(built.pad.sensors.position_m, position_m, axis, built.pad.magnet)
        return built.sensed(self._ambients(sampled_s) + magnet_t)

    def _ambients(self, sampled_s: Array) -> Array:
        """(K, N, 3) the ambient field at the times (K, N)."""
        if self.tumbling:
            return np.array([self._ambient(row) for row in sampled_s])
        earth_t = self._built.ambient_t
        angle, along = (self.turning_rad_per_s * sampled_s)[:, :, None], TURNING_AXIS @ earth_t
        # Rodrigues' formula, as in `rotation_from_vector`.
        ambient_t = (
            np.cos(angle) * earth_t
            + np.sin(angle) * np.cross(TURNING_AXIS, earth_t)
            + (1.0 - np.cos(angle)) * along * TURNING_AXIS
        )
        return np.asarray(ambient_t)


def wire_frames(
    sequence: NDArray[np.int64],
    sampled_s: Array,
    fresh: NDArray[np.bool_],
    counts: NDArray[np.int16],
    gain_code: int,
    told_c: float | None = ROOM_C,
) -> list[WireFrame]:
    newest_s = sampled_s.max(axis=1)
    readings = np.empty((*fresh.shape, 4), "<i2")
    readings[:, :, :3] = counts
    readings[:, :, 3] = np.rint((newest_s[:, None] - sampled_s) * 1e6).astype(np.uint16).view(np.int16)
    every = (1 << fresh.shape[1]) - 1
    masks = fresh @ (1 << np.arange(fresh.shape[1]))
    size, data = READING_BYTES * fresh.shape[1], readings.tobytes()
    device_us = np.maximum(np.rint(newest_s * 1e6).astype(np.int64), 0)
    host_ns = np.rint(newest_s * 1e9).astype(np.int64)
    rows = zip(sequence.tolist(), device_us.tolist(), host_ns.tolist(), masks.tolist(), strict=True)
    return [
        WireFrame(0, number, time_us, time_ns, (gain_code, every, mask, data[size * row : size * (row + 1)]), told_c)
        for row, (number, time_us, time_ns, mask) in enumerate(rows)
    ]
