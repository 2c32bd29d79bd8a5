"""The whole job of one pad whose magnets are unknown: frame → field → contact → message.

It has the interface of `PadPipeline`, so that the daemon, a replay and a recorder do not know which of the two it is
(fmfts.pipeline.plugged).
Its frames are judged in Python; no lane hands them to C from a board's bytes.
"""

from __future__ import annotations

import time
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmfts.baseline import Baseline
from fmfts.baseline.rest_field import RestField
from fmfts.bus.messages import NO_ESTIMATE, ContactMessage, Health
from fmfts.common.memory import require_alike
from fmfts.pad import Pad, Placement
from fmfts.pipeline.last_frame import LastFrame
from fmfts.pipeline.sensors_ok import mask_of
from fmfts.pipeline.words import NO_BASELINE
from fmfts.pose import Alignment, repeats_allowed
from fmfts.pose.alignment import AlignmentMemory
from fmfts.pose.sighting import Sighting
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.sensor.missing import missing_sensors
from fmfts_skin.estimator import SkinEstimator, SkinMemory, SkinReading
from fmfts_skin.force_estimator import ForceEstimator
from fmfts_skin.model import SkinForceModel, SkinModel

BARE_ONLY = "rest not recorded: `fmfts-daemon baseline --rest` while nothing touches the pad"


@dataclass(slots=True)
class SkinPipelineMemory:
    """As PipelineMemory, of a pad whose magnets are unknown."""

    alignment: AlignmentMemory
    skin: SkinMemory | None
    number: int
    sampled_ns: int
    why_no_estimator: str


class SkinPipeline:
    """Makes a message of each frame of one pad whose magnets are unknown.

    ambient_t: by how much the ambient field may change, along each axis. magnet_per_k: temperature coefficient of the
    remanence.
    """

    memory_kind = SkinPipelineMemory

    def __init__(
        self,
        pad: Pad,
        model: SkinModel | SkinForceModel,
        boot: str,
        rate_hz: float,
        ambient_t: float,
        magnet_per_k: float,
    ) -> None:
        self.pad, self.model, self._boot = pad, model, boot
        self._rate_hz, self._ambient_t, self._magnet_per_k = rate_hz, ambient_t, magnet_per_k
        self._alignment = Alignment(len(pad.sensors), period_us=1e6 / rate_hz)
        self._estimator: SkinEstimator | ForceEstimator | None = None
        self._at_first: SkinMemory | None = None  # the estimator's memory before any frame
        self._why_none = NO_BASELINE
        self._baseline: Baseline | None = None
        self.messages, self._sampled_ns = 0, 0
        self.missing: dict[int, str] = {}
        self._last_frame = LastFrame(rate_hz)

    @property
    def baseline(self) -> Baseline | None:
        return self._baseline

    @property
    def model_hash(self) -> str:
        return self.model.hash

    @property
    def force_scale_sd(self) -> float | None:
        """Deviation of the scale of all forces through the silicone, as a share; None: not known."""
        return None

    @property
    def mounting(self) -> RestField | None:
        return None if self._estimator is None else self._estimator.mounting

    def use(self, baseline: Baseline, mounting: RestField | None = None) -> RestField | None:
        """From the next frame on, count changes from this rest. None, and nothing is told yet, without one.

        BaselineError if it does not fit the pad.
        """
        self._baseline = baseline
        if baseline.rest is None:
            self._estimator, self._why_none = None, BARE_ONLY
            return None
        mounting = mounting or baseline.rest_field()
        repeats = repeats_allowed(mounting.noise_t, self.pad.chip.coarseness_t(baseline.rest.gain_code))
        around = self._ambient_t, self._rate_hz, repeats, self._magnet_per_k
        if isinstance(self.model, SkinForceModel):
            self._estimator = ForceEstimator(self.pad, mounting, self.model, *around)
        else:
            self._estimator = SkinEstimator(self.pad, mounting, self.model.response, *around)
        self._at_first = deepcopy(self._estimator.memory)
        return mounting

    def feel(self, neighbour: Sighting, placement: Placement) -> None:
        """Its configuration names no neighbours (checks.py)."""

    def be_felt(self) -> Sighting:
        """Nor does another pad's name it: nobody knows where its magnets are."""
        return Sighting.unseen(self.pad)

    def start_anew(self) -> None:
        """Forget all frames, because the next have another clock, or an error left half a memory. A new estimator would
        take 15 ms, in which all other pads wait."""
        self._alignment = Alignment(len(self.pad.sensors), period_us=1e6 / self._rate_hz)
        if self._estimator is not None and self._at_first is not None:
            self._estimator.memory = deepcopy(self._at_first)

    def refuse(self, reason: str) -> None:
        """Publish `reason` in every message: there is a baseline, but it cannot be used."""
        self._estimator = self._baseline = None
        self._why_none = reason

    def process(self, frame: Frame) -> ContactMessage:
        """Make the message of one frame."""
        aligned = self._last_frame.aligned(frame, frame.field_t, self._alignment)
        if frame.valid.any() and not aligned.is_old:
            # Else the frame holds no new sample, so the newest is still the last one.
            self._sampled_ns = frame.host_time_ns - (frame.device_time_us - aligned.time_us) * 1000
        estimator = self._estimator
        if estimator is None:
            self.missing = missing_sensors(frame, None)
            reading = SkinReading("no_baseline", self._why_none, frame.usable)
        else:
            self.missing = missing_sensors(frame, aligned.repeats > estimator.repeats_allowed)
            reading = estimator.read(aligned, frame.temperature_c, self.missing)
        return self._message(reading, frame.temperature_c)

    def answer(self, frame: Frame) -> ContactMessage:
        return self.process(frame)

    def _message(self, reading: SkinReading, temperature_c: float | None) -> ContactMessage:
        self.messages += 1
        return ContactMessage(
            pad=self.pad.name,
            boot=self._boot,
            seq=self.messages,
            t_sample_ns=self._sampled_ns,
            t_publish_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            temperature_c=temperature_c,
            health=reading.health,
            reason=reading.reason,
            **(NO_ESTIMATE | {"over_range": False} | self._estimates(reading)),
            sensors_ok=mask_of(reading.used),
            model=self.model.hash,
            baseline=None if self._baseline is None else self._baseline.id,
        )

    def _estimates(self, reading: SkinReading) -> dict[str, Any]:
        """Beyond the table there is only a lower bound of the force, and no place. Without a contact there is none."""
        if reading.contact is None or reading.deviation is None:
            return {"contact": reading.touching}
        values = zip(reading.contact.tolist(), reading.deviation.tolist(), strict=True)
        told = dict(zip(self.model.told_names, values, strict=True))
        found: dict[str, Any] = {"contact": True, "over_range": reading.beyond}
        if reading.beyond:
            if isinstance(self.model, SkinForceModel):
                return found
            force_n = min(max(told[self.model.told_names[-1]][0], 0.0), self.model.largest_load)
            return found | ({"force_min_n": force_n} if "force_n" in told else {})
        for name in ("x", "y"):
            if (key := f"{name}_mm") in told:
                value, deviation = told[key]
                found |= {f"{name}_m": value * 1e-3, f"{name}_sd_m": deviation * 1e-3}
        for name in ("shear_x", "shear_y"):
            if (key := f"{name}_n") in told:
                found |= {key: told[key][0], f"{name}_sd_n": told[key][1]}
        if "force_n" in told:
            value, deviation = told["force_n"]
            found |= {"force_n": max(value, 0.0), "force_sd_n": deviation}
        return found

    def host_time_ns(self, device_time_us: int) -> int:
        """The host's time of the board's, near the last frame."""
        return self._last_frame.host_time_ns(device_time_us)

    def early(self, early: EarlySample) -> None:
        """A sample that comes before its frame says nothing new."""

    def begin(self, clock: memoryview, topic: bytes, pad_index: int, overdue_ns: int) -> None:
        """No C handles the frames of such a pad from the board's bytes."""

    @property
    def memory(self) -> SkinPipelineMemory:
        """What the pipeline remembers between two frames."""
        skin = None if self._estimator is None else self._estimator.memory
        return SkinPipelineMemory(self._alignment.memory, skin, self.messages, self._sampled_ns, self._why_none)

    def recall(self, memory: SkinPipelineMemory) -> None:
        """Continue from the memory of another pipeline of the same configuration and baseline.

        ValueError, and nothing changes, if the memory does not fit this pipeline.
        """
        require_alike(memory, self.memory)
        self._alignment.memory = memory.alignment
        if self._estimator is not None and memory.skin is not None:
            self._estimator.memory = memory.skin
        self.messages, self._sampled_ns = memory.number, memory.sampled_ns
        self._why_none = memory.why_no_estimator

    def absent(self, health: Health, reason: str) -> ContactMessage:
        """The message to publish while no frame can be used. It ends the touch: whoever touched may be gone."""
        if self._estimator is not None:
            self._estimator.forget_touch()
        self.missing = {}
        return self._message(SkinReading(health, reason, np.zeros((len(self.pad.sensors), 3), dtype=np.bool_)), None)
