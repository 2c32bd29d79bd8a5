"""A pad with its baseline: all that is settled before the first frame is read."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product, root_of_squares
from fmfts.baseline import Baseline, Mounting
from fmfts.pad import Pad
from fmfts.pose import (
    AMBIENT,
    PAPER,
    Part,
    PoseEstimate,
    SensorErrors,
    Status,
    Tracker,
    TrackingModel,
    change_from,
    in_nominal_frame,
    repeats_allowed,
    solve,
    widened,
)
from fmfts.pose.ambient_motion import AmbientMotionDetector

Array = NDArray[np.float64]


class BaselinedPad:
    """drawing: what was meant; pad: what is mounted. at_rest: is rest recorded? Without it, nothing is known of moment
    or drift, and the paper's own method serves, its dipole too. repeats_allowed: see `fmfts.pose.repeats_allowed`."""

    def __init__(self, drawing: Pad, baseline: Baseline, mounting: Mounting, scene: TrackingModel) -> None:
        recorded = baseline.rest or baseline.bare
        assert recorded is not None  # or there would be no mounting
        self.drawing = drawing
        self.baseline = baseline
        self.mounting = mounting
        self.at_rest = baseline.rest is not None
        pad = mounting.mounted(drawing)
        self.pad = pad if self.at_rest else replace(pad, magnet=replace(pad.magnet, as_cylinder=False))
        self.temperature_c = recorded.temperature_c if self.at_rest else None
        self.tracking = scene if self.at_rest else PAPER
        self.repeats_allowed = repeats_allowed(mounting.noise_t, drawing.chip.step_t[recorded.gain_code])
        self.change_error = mounting.change_error(self.tracking.estimated)
        self._change_error_rows = self.change_error.reshape(5, -1)

    @classmethod
    def of(cls, drawing: Pad, baseline: Baseline, scene: TrackingModel, mounting: Mounting | None = None) -> Self:
        """mounting: where it is known already. BaselineError where the baseline does not fit the pad."""
        return cls(drawing, baseline, mounting or baseline.mounting(drawing), scene)

    def tracker(self) -> Tracker:
        errors = SensorErrors(self.mounting.noise_t, self.mounting.field_errors()) if self.at_rest else None
        return Tracker(self.pad, self.mounting.rest, self.tracking, self.temperature_c, errors)

    def ambient_motion(self) -> AmbientMotionDetector | None:
        """None where the ambient field may change."""
        is_constant = self.at_rest and self.tracking.parts[AMBIENT.start] == Part.FIXED
        return AmbientMotionDetector(self.pad, self.mounting.rest) if is_constant else None

    def with_calibration_uncertainty(self, estimate: PoseEstimate) -> PoseEstimate:
        """As uncertain as what mounting leaves open makes the pose's change from rest."""
        change = change_from(self.mounting.rest, estimate)
        error = (product(change, self._change_error_rows)).reshape(len(change), -1)
        return widened(estimate, self.mounting.rest, product(error, error.T))

    def in_nominal_frame(self, estimate: PoseEstimate) -> tuple[Array, Array, Array]:
        """The change of pose from this pad's rest, put on the drawing's: position, axis, covariance (6, 6) of both."""
        return in_nominal_frame(estimate, self.mounting.rest, self.drawing)

    def resting_covariance(self) -> Array | None:
        """(6, 6) of one frame at rest, as drawn; None where rest is not recorded, or cannot be solved."""
        if not self.at_rest:
            return None
        deviation_t = root_of_squares(self.mounting.noise_t, self.mounting.systematic_t)
        field_t, rest = self.mounting.rest_field_t, self.mounting.rest
        estimate = solve(field_t, self.pad, rest, deviation_t=deviation_t, free=self.tracking.estimated)
        return self.in_nominal_frame(estimate)[2] if estimate.status is Status.CONVERGED else None

    @property
    def refuted(self) -> str:
        """What is said where the magnet stands above its rest."""
        return (
            f"the magnet stood above the rest that baseline {self.baseline.id} recorded, where no press puts it: that "
            "was recorded under load; record it again while nothing touches the pad"
        )
