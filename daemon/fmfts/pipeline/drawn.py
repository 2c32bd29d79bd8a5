"""A pose of a mounted pad as the pad of the drawing would have it under the same load: change.c without a frame."""

from __future__ import annotations

import numpy as np

from fmfts.common.record import Record
from fmfts.pad import Array, Pad, Silicone
from fmfts.pipeline import _pad
from fmfts.pose import PoseEstimate, State
from fmfts.pose.change import UPRIGHT, shortest_rotation
from fmfts.pose.silicone import silicone_fields


class NominalFrame:
    """Of one mounted pad.

    The position is the drawing's rest plus the displacement, turned back by the tilt of the whole pad. The axis is
    turned by the rotation that takes this pad's rest axis to the drawing's. The two differ by a degree or so: the
    load's own tilt is then right to second order.
    """

    def __init__(
        self,
        rest: State,
        drawing: Pad,
        change_error: Array | None = None,
        silicone: Silicone | None = None,
        pad_turn: Array = UPRIGHT,
    ) -> None:
        """pad_turn (3, 3): see `Mounting.pad_turn`. These also widen the covariance: change_error (8, 5, M), see
        `Mounting.change_error`; silicone, as a share of the change itself."""
        self._parameters = Record(_pad.PARAMETERS)
        self._parameters.fill(
            {
                "rest": rest.vector(),
                "drawn_rest_m": drawing.rest_position_m,
                "drawn_turn": shortest_rotation(rest.axis, drawing.rest_axis),
                "pad_turn": pad_turn,
            }
        )
        if change_error is not None:
            self._parameters.fill({"leftovers": change_error.shape[-1], "change_error": change_error})
        if silicone is not None:
            self._parameters.fill(silicone_fields(silicone, 0.0))

    def pose(self, estimate: PoseEstimate) -> tuple[Array, Array, Array]:
        """Position (3,) m, axis (3,), covariance (6, 6)."""
        pose, spread, state = np.zeros(6), np.zeros((6, 6)), estimate.state.vector()[: _pad.STATE]
        covariance = np.ascontiguousarray(estimate.covariance[: _pad.STEP, : _pad.STEP])
        _pad.drawn(self._parameters.buffer, state, covariance, pose, spread)
        return pose[:3], pose[3:], spread


def in_nominal_frame(
    estimate: PoseEstimate, rest: State, drawing: Pad, pad_turn: Array = UPRIGHT
) -> tuple[Array, Array, Array]:
    """The pose of a pad that rests at `rest`, as the drawing's: position (3,), axis (3,), covariance (6, 6)."""
    return NominalFrame(rest, drawing, pad_turn=pad_turn).pose(estimate)
