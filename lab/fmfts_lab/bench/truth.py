"""Compares published messages with the truth of the simulated pad."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmfts.bus.messages import ContactMessage, PoseMessage
from fmfts.pad import Array
from fmfts_simulation.finger import Finger, Touch, columns
from fmfts_simulation.mounted import MountedPad

# An error of more than this many published deviations is a wrong answer.
WRONG_DEVIATIONS = 5.0
PUBLISHED = ("ok", "degraded")


class Truth:
    """The true state of a simulated pad at a moment, and the errors of messages."""

    def __init__(self, built: MountedPad, finger: Finger) -> None:
        self._built = built
        self._finger = finger

    def deviations(self, message: ContactMessage) -> float:
        """The largest error of the published numbers, in their published deviations."""
        return float(self.all_deviations([message])[0])

    def all_deviations(self, messages: Sequence[ContactMessage]) -> Array:
        """(K,) `deviations` of each message."""
        worst = np.zeros(len(messages))
        posed, poses, touches, times_s = [], [], [], []
        for number, message in enumerate(messages):
            if message.health not in PUBLISHED:
                continue
            touch = self._finger(message.t_sample_ns * 1e-9)
            worst[number] = max(self._contact_errors(message, touch), default=0.0)
            if message.force_min_n is not None and message.force_min_n > touch.force_n:
                # A lower bound of the force already includes three deviations, so any violation counts as infinite.
                worst[number] = np.inf
            if message.pose is not None:
                posed.append(number)
                poses.append(message.pose)
                touches.append(touch)
                times_s.append(message.t_sample_ns * 1e-9)
        if posed:
            worst[posed] = np.maximum(worst[posed], self._pose_deviations(poses, self.poses(times_s, touches)))
        return worst

    def contact_errors(self, message: ContactMessage) -> list[float]:
        """Errors of the published places and forces, in their published deviations."""
        return self._contact_errors(message, self._finger(message.t_sample_ns * 1e-9))

    def _contact_errors(self, message: ContactMessage, touch: Touch) -> list[float]:
        pairs = [
            (message.x_m, message.x_sd_m, touch.x_m),
            (message.y_m, message.y_sd_m, touch.y_m),
            (message.force_n, message.force_sd_n, touch.force_n),
        ]
        return [abs(value - truth) / sd for value, sd, truth in pairs if value is not None and sd is not None]

    def poses(self, times_s: Sequence[float], touches: Sequence[Touch]) -> tuple[Array, Array]:
        """Position (K, 3) m and axis (K, 3) of the magnet at these times, under these touches."""
        return self._built.pose(*columns(touches))

    def _pose_deviations(self, poses: Sequence[PoseMessage], true: tuple[Array, Array]) -> Array:
        position_m, axis = true
        away = np.abs(np.array([pose.position_m for pose in poses]) - position_m)
        away /= np.array([pose.position_sd_m for pose in poses])
        # The deviation is that of one direction; an error in both directions together is √2 times as large.
        cosine = np.sum(np.array([pose.axis for pose in poses]) * axis, axis=1)
        turned = np.arccos(np.minimum(cosine, 1.0)) / (np.sqrt(2.0) * np.array([pose.axis_sd_rad for pose in poses]))
        worst: Array = np.maximum(away.max(axis=1), turned)
        return worst
