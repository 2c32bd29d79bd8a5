"""One pad's baseline following a slow drift by itself, where its owner allows it ([pad.rebaseline])."""

from __future__ import annotations

import logging

import numpy as np

from fmfts.baseline import Baseline, DriftFollower, Mounting, Quiet
from fmfts.bus.messages import ContactMessage
from fmfts.pad import DriftLimits
from fmfts.pipeline.contact_message import PackedMessage, felt_force_sd_n
from fmfts.pipeline.fast import Kind
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import follow

log = logging.getLogger(__name__)

# Every frame must be quiet; of so many one is unpacked for the mean, of which there are more than enough.
LOOKED_AT = 11


class Rebaselining:
    """Of one baseline, from when it was recorded."""

    def __init__(self, pipeline: PadPipeline, recorded: Baseline, mounting: Mounting, limits: DriftLimits) -> None:
        self._pipeline = pipeline
        self._recorded = recorded
        self._mounting = mounting
        self._follower = DriftFollower(mounting.rest, limits)
        self._frames = 0

    @property
    def size_m(self) -> float:
        return self._follower.size_m

    def saw(self, answer: ContactMessage | PackedMessage) -> bool:
        """What was made of a frame. True where the pipeline now measures from another rest."""
        self._frames += 1
        if isinstance(answer, PackedMessage) and answer.kind is Kind.QUIET and self._frames % LOOKED_AT:
            return False
        reading = _quiet(answer.message if isinstance(answer, PackedMessage) else answer, self._pipeline.unfelt_n)
        if reading is None:
            self._follower.disturbed()
            return False
        if not self._follower.saw(reading):
            return False
        moved = self._follower.moved
        follow(self._pipeline, self._recorded.drifted(moved), self._mounting.drifted(moved))
        x, y, z = moved[:3] * 1e6
        log.info("pad '%s': its rest drifted, (%+.1f, %+.1f, %+.1f) µm by now", self._pipeline.pad.name, x, y, z)
        return True


def _quiet(message: ContactMessage, unfelt_n: float) -> Quiet | None:
    """None where it does not say for sure that nothing touches, as far as the middle of the pad can tell."""
    pose, force_n, force_sd_n = message.pose, message.force_n, message.force_sd_n
    if message.health != "ok" or message.contact is not False or message.over_range:
        return None
    if pose is None or force_n is None or force_sd_n is None:
        return None
    place, axis = np.array(pose.position_m), np.array(pose.axis)
    return Quiet(message.t_sample_ns * 1e-9, place, axis, force_n, felt_force_sd_n(force_sd_n, unfelt_n))
