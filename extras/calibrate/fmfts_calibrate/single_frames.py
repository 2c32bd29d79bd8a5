"""The pose from a single frame of a mounted pad, without earlier frames, in the contact model's units."""

from __future__ import annotations

import numpy as np

from fmfts.contact.model import POSE_UNIT
from fmfts.contact.response import CHANGE
from fmfts.pad import Array
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.drawn import NominalFrame
from fmfts.pose import Status, solve

UNIT = POSE_UNIT[:CHANGE]


class SingleFrames:
    """For one pad with its baseline. noise_t: of a field value."""

    def __init__(self, baselined: BaselinedPad, noise_t: float) -> None:
        drawing, mounting = baselined.drawing, baselined.mounting
        self._baselined, self._noise_t = baselined, noise_t
        self._nominal = NominalFrame(
            mounting.rest, drawing, baselined.change_error, drawing.silicone, mounting.pad_turn
        )
        self._rest = np.concatenate([drawing.rest_position_m, drawing.rest_axis[:2]])

    def change(self, change_t: Array) -> tuple[Array, Array] | None:
        """The change of pose (5,), in mm and components of the axis, and its covariance (5, 5), from the change of the
        magnet's field (N, 3) since rest, along the sensors' axes. None if no pose explains it."""
        mounting = self._baselined.mounting
        estimate = solve(
            mounting.rest_field_t + change_t,
            self._baselined.pad,
            mounting.rest,
            deviation_t=self._noise_t,
            free=self._baselined.tracking.estimated,
        )
        if estimate.status is not Status.CONVERGED:
            return None
        position_m, axis, covariance = self._nominal.pose(estimate)
        changed = np.concatenate([position_m, axis[:2]]) - self._rest
        return changed * UNIT, covariance[:CHANGE, :CHANGE] * UNIT * UNIT[:, None]
