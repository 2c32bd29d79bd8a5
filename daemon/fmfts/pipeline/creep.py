"""The change of pose that earlier loads left: silicone.c without frames."""

from __future__ import annotations

import numpy as np

from fmfts.common.record import Record
from fmfts.pad import Array, Silicone
from fmfts.pipeline import _pad
from fmfts.pose.silicone import silicone_fields


class Creep:
    """Follows the loads of one pad. longest_gap_s: after a longer one the load in between is unknown."""

    def __init__(self, silicone: Silicone, longest_gap_s: float) -> None:
        self._parameters, self._memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
        self._parameters.fill({"rest": _state_of(np.zeros(5)), **silicone_fields(silicone, longest_gap_s)})

    def left_behind(self, change: Array, elapsed_s: float) -> Array:
        """The covariance (5, 5) of that, after a change (5,) of pose from rest, so long after the last one."""
        left = np.zeros((5, 5))
        self._memory.put("state", _state_of(change))
        _pad.left_behind(self._parameters.buffer, self._memory.buffer, left, elapsed_s)
        return left


def _state_of(change: Array) -> Array:
    """The state (15,) of a magnet that rests at the origin, upright."""
    return np.concatenate([change, [1.0], np.zeros(9)])
