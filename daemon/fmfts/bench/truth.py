"""Whether what is published is true."""

from __future__ import annotations

from math import acos

import numpy as np

from fmfts.bus.messages import ContactMessage
from fmfts.simulate.finger import Finger, Touch
from fmfts.simulate.mounted import MountedPad

# An error of more than this many published deviations is a wrong answer.
WRONG_DEVIATIONS = 5.0
PUBLISHED = ("ok", "degraded")


class Truth:
    """What a simulated pad really is at a moment, and how far a message is from it."""

    def __init__(self, built: MountedPad, finger: Finger) -> None:
        self._built = built
        self._finger = finger

    def deviations(self, message: ContactMessage) -> float:
        """The largest error of a number that is published as good, in its published deviations."""
        if message.health not in PUBLISHED:
            return 0.0
        touch = self._finger(message.t_sample_ns * 1e-9)
        errors = self.contact_errors(message)
        if message.force_min_n is not None and message.force_min_n > touch.force_n:
            # A bound has three deviations in it already, and none beside it.
            errors.append(np.inf)
        if message.pose is not None:
            errors += self._pose_errors(message, touch)
        return float(max(errors, default=0.0))

    def contact_errors(self, message: ContactMessage) -> list[float]:
        """Errors of place and force in their published deviations, of those that are published."""
        touch = self._finger(message.t_sample_ns * 1e-9)
        pairs = [
            (message.x_m, message.x_sd_m, touch.x_m),
            (message.y_m, message.y_sd_m, touch.y_m),
            (message.force_n, message.force_sd_n, touch.force_n),
        ]
        return [abs(value - truth) / sd for value, sd, truth in pairs if value is not None and sd is not None]

    def _pose_errors(self, message: ContactMessage, touch: Touch) -> list[float]:
        assert message.pose is not None
        (position,), (axis,) = self._built.pose(*(np.array([value]) for value in touch))
        away = np.abs(np.array(message.pose.position_m) - position) / message.pose.position_sd_m
        # Two directions share the deviation: a turn of both at once is √2 of it.
        turned = acos(min(float(np.array(message.pose.axis) @ axis), 1.0)) / (np.sqrt(2.0) * message.pose.axis_sd_rad)
        return [*away.tolist(), turned]
