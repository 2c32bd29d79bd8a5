"""The whole job of one pad whose magnets are unknown: frame → field → contact → message.

It has the interface of `PadPipeline`, so that the daemon, a replay and a recorder do not know which of the two it is
(fmfts.pipeline.plugged).
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmfts.baseline import Baseline
from fmfts.baseline.rest_field import RestField
from fmfts.bus.messages import NO_ESTIMATE, ContactMessage, Health
from fmfts.common.memory import require_alike
from fmfts.pad import Pad, Placement
from fmfts.pose import repeats_allowed
from fmfts.pose.alignment import AlignmentMemory
from fmfts.pose.hand import Hand
from fmfts.pose.sighting import Sighting
from fmfts.sensor import Frame
from fmfts.sensor.missing import missing_sensors
from fmfts_calibrate.tracked import Scene
from fmfts_skin.estimator import SkinEstimator
from fmfts_skin.force_estimator import ForceEstimator
from fmfts_skin.judged_in_python import JudgedInPython
from fmfts_skin.model import SkinForceModel, SkinModel
from fmfts_skin.pose_values import PoseValues
from fmfts_skin.rested import RestedPad, SkinMemory, SkinReading

BARE_ONLY = "rest not recorded: `fmfts-daemon baseline --rest` while nothing touches the pad"


@dataclass(slots=True)
class SkinPipelineMemory:
    """Like PadMemory, for a pad with unknown magnets."""

    alignment: AlignmentMemory
    skin: SkinMemory | None
    number: int
    sampled_ns: int
    why_no_estimator: str


class SkinPipeline(JudgedInPython):
    """Makes a message of each frame of one pad whose magnets are unknown.

    ambient_t: by how much the ambient field may change, along each axis. magnet_per_k: temperature coefficient of the
    remanence. scene: whether poses leave the ambient field free.
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
        hand: Hand | None = None,
        scene: Scene = "drifting",
    ) -> None:
        super().__init__(pad, model.hash, boot, rate_hz, hand)
        self.model, self._ambient_t, self._magnet_per_k, self._scene = model, ambient_t, magnet_per_k, scene
        self._estimator: RestedPad | None = None
        self._at_first: SkinMemory | None = None  # the estimator's memory before any frame

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
        rested = self.pad, mounting, self._ambient_t, self._rate_hz, repeats, self._magnet_per_k
        if isinstance(self.model, SkinForceModel):
            poses = self._poses_of(baseline, mounting) if self.model.needs_poses else None
            self._estimator = ForceEstimator(*rested, self.model, poses)
        else:
            self._estimator = SkinEstimator(*rested, self.model.response)
        self._at_first = deepcopy(self._estimator.memory)
        if self.hand is not None:
            self.hand.use(None if baseline.posture is None else baseline.posture.model())
        return mounting

    def _poses_of(self, baseline: Baseline, rest: RestField) -> PoseValues:
        return PoseValues(
            self.pad, rest.rest_t, self._scene, float(np.nanmean(rest.noise_t)), baseline.mounting(self.pad)
        )

    def feel(self, neighbour: Sighting, placement: Placement) -> None:
        """Does nothing: such a pad's configuration names no neighbours (checks.py)."""

    def be_felt(self) -> Sighting:
        """An unseen sighting: nobody knows where its magnets are, and no other pad may name it."""
        return Sighting.unseen(self.pad)

    def start_anew(self) -> None:
        """Forget all frames, because the next have another clock, or an error left half a memory. A new estimator would
        take 15 ms, in which all other pads wait."""
        self._forget_samples()
        if self._estimator is not None and self._at_first is not None:
            self._estimator.memory = deepcopy(self._at_first)

    def refuse(self, reason: str) -> None:
        """Publish `reason` in every message: there is a baseline, but it cannot be used."""
        self._estimator = self._baseline = None
        self._why_none = reason

    def process(self, frame: Frame) -> ContactMessage:
        """Make the message of one frame."""
        aligned = self._aligned(frame)
        estimator = self._estimator
        if estimator is None:
            self.missing = missing_sensors(frame, None)
            reading = SkinReading("no_baseline", self._why_none, frame.usable)
        else:
            self.missing = missing_sensors(frame, aligned.repeats > estimator.repeats_allowed)
            reading = estimator.read(aligned, frame.temperature_c, self.missing)
        return self._message(reading, self._told(reading), frame.temperature_c)

    def _told(self, reading: SkinReading) -> dict[str, Any]:
        return NO_ESTIMATE | {"over_range": False} | self._estimates(reading)

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
        reading = SkinReading(health, reason, np.zeros((len(self.pad.sensors), 3), dtype=np.bool_))
        return self._message(reading, self._told(reading), None)
