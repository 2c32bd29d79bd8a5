"""Lets a pad's baseline follow a slow drift by itself, if the configuration allows it ([pad.rebaseline])."""

from __future__ import annotations

import logging
from math import sqrt

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.baseline import Baseline, DriftFollower, Mounting, Quiet
from fmfts.baseline.drift import size_of
from fmfts.bus.messages import ContactMessage
from fmfts.pad import DriftLimits
from fmfts.pipeline.creep import Creep
from fmfts.pipeline.encoded import Answer, message_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import follow
from fmfts.pose.state import tangent_basis

log = logging.getLogger(__name__)

# Interval of the frames that are decoded.
LONGEST_GAP_S = 1.0
# Every frame must be quiet, but decoding one in this many is enough for the mean.
LOOKED_AT = 11


class Rebaselining:
    """Follows the drift of one recorded baseline."""

    def __init__(self, pipeline: PadPipeline, recorded: Baseline, mounting: Mounting, limits: DriftLimits) -> None:
        self._pipeline = pipeline
        self._recorded = recorded
        self._mounting = mounting
        self._follower = DriftFollower(mounting.rest, limits)
        self._frames = 0
        self._silicone = Creep(pipeline.pad.silicone, LONGEST_GAP_S)
        self._basis = tangent_basis(mounting.rest.axis)
        self._seen_s: float | None = None
        # The remaining recovery of the silicone must be smaller than one step.
        self._largest_recovery_m = limits.rate_m_per_s * limits.quiet_s

    @property
    def size_m(self) -> float:
        return self._follower.size_m

    def saw(self, answer: Answer) -> bool:
        """Take the pipeline's answer to a frame. True if the pipeline now uses another rest pose."""
        self._frames += 1
        if _is_untouched(answer) and self._frames % LOOKED_AT:
            return False
        message = message_of(answer)
        reading = _quiet(message, self._pipeline.detection_limit_n)
        if self._is_recovering(message) or reading is None:
            self._follower.disturbed()
            return False
        if not self._follower.saw(reading):
            return False
        moved = self._follower.moved
        follow(self._pipeline, self._recorded.drifted(moved), self._mounting.drifted(moved))
        x, y, z = moved[:3] * 1e6
        log.info("pad '%s': its rest drifted, (%+.1f, %+.1f, %+.1f) µm by now", self._pipeline.pad.name, x, y, z)
        return True

    def _is_recovering(self, message: ContactMessage) -> bool:
        """Whether the remaining creep of earlier loads may exceed a step of the rest pose."""
        if message.pose is None:
            return True
        now_s, rest = message.t_sample_ns * 1e-9, self._mounting.rest
        elapsed_s, self._seen_s = max(now_s - (now_s if self._seen_s is None else self._seen_s), 0.0), now_s
        axis = product(self._basis.T, np.array(message.pose.axis))
        change = np.append(np.array(message.pose.position_m) - rest.position_m, axis) - self._follower.moved
        left = self._silicone.left_behind(change, elapsed_s)
        return size_of(np.sqrt(np.diagonal(left))) > self._largest_recovery_m


def _is_untouched(answer: Answer) -> bool:
    """Whether the message is certain that nothing touches the pad."""
    return answer.health == "ok" and answer.contact is False and not answer.over_range


def _quiet(message: ContactMessage, detection_limit_n: float) -> Quiet | None:
    """The reading of an untouched pad; None if the message does not exclude a touch."""
    pose, force_n, force_sd_n = message.pose, message.force_n, message.force_sd_n
    if not _is_untouched(message) or pose is None or force_n is None or force_sd_n is None:
        return None
    place, axis = np.array(pose.position_m), np.array(pose.axis)
    return Quiet(message.t_sample_ns * 1e-9, place, axis, force_n, _felt_force_sd_n(force_sd_n, detection_limit_n))


def _felt_force_sd_n(quiet_sd_n: float, detection_limit_n: float) -> float:
    """Deviation (N) of the force of an untouched pad, without the detection limit that its message counts: the inverse
    of `quiet_force_sd_n` of pipeline/contact_of_pose.c."""
    return sqrt(max(square(quiet_sd_n) - square(detection_limit_n) / 3.0, 0.0))
