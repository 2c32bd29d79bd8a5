"""A χ² test of the displacement from rest: its thresholds, and a pad with several magnets. touch.c has the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.common.chi2 import quantile
from fmfts.contact import _contact
from fmfts.contact._contact import RELEASE_FRAMES
from fmfts.pad import Array

DEGREES_OF_FREEDOM = 5  # position, and the axis's two tangents, of each magnet
# A contact ends when RELEASE_FRAMES in a row are as close to rest as 99 % of unloaded frames (touch.c).
RELEASE_PROBABILITY = 0.01


@dataclass(slots=True)
class TouchMemory:
    """touched: a magnet has moved. quiet_frames: how many frames in a row were as close to rest as unloaded ones."""

    touched: bool = False
    quiet_frames: int = 0


class TouchDetector:
    """Contact or none, frame by frame.

    A contact begins with one frame whose χ² exceeds a threshold. At `rate_hz`, an unloaded pad exceeds that threshold
    `false_contacts_per_hour` times in an hour, if frames are independent and the covariance is right. magnets: of the
    pad.
    """

    def __init__(
        self,
        rate_hz: float,
        false_contacts_per_hour: float = 1.0,
        magnets: int = 1,
    ) -> None:
        per_frame = false_contacts_per_hour / (3600.0 * rate_hz)
        self.onset_chi2 = quantile(min(per_frame, RELEASE_PROBABILITY), DEGREES_OF_FREEDOM * magnets)
        self.release_chi2 = quantile(RELEASE_PROBABILITY, DEGREES_OF_FREEDOM * magnets)
        # After a longer gap, the finger may be gone. Half a period is for jitter.
        self.longest_gap_s = (RELEASE_FRAMES + 0.5) / rate_hz
        self.memory = TouchMemory()

    def update(self, change: Array, covariance: Array) -> bool | None:
        """Whether the pad is touched after this frame; None, and nothing changes, if the frame has no usable pose.

        change (5M,): from rest, position in m and axis in rad; covariance (5M, 5M): includes that of rest.
        """
        return self.memory.touched if self._follow(change, covariance) else None

    def unseen(self) -> None:
        """A frame without a pose. After RELEASE_FRAMES of them a contact is released, and a new one needs an onset."""
        self._follow(np.empty(0), np.empty((0, 0)))

    def _follow(self, change: Array, covariance: Array) -> bool:
        memory, given = self.memory, (np.ascontiguousarray(change), np.ascontiguousarray(covariance))
        memory.touched, memory.quiet_frames, is_known = _contact.touch(
            self.onset_chi2, self.release_chi2, memory.touched, memory.quiet_frames, *given
        )
        return is_known

    def forget(self) -> None:
        """Begin again, untouched."""
        self.memory.touched, self.memory.quiet_frames = False, 0
