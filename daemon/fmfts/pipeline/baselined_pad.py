"""A pad with its baseline: all that is known before the first frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline import Baseline, Mounting
from fmfts.pad import Pad
from fmfts.pipeline.drawn import NominalFrame
from fmfts.pose import (
    PAPER,
    PoseEstimate,
    Status,
    TrackingModel,
    repeats_allowed,
    solve,
)
from fmfts.pose.hidden_gradient import (
    EVEN_T,
    STANDS_STILL,
    HiddenGradient,
    Reference,
    effect_of_field,
    effect_of_gradient,
    reference_of,
)

Array = NDArray[np.float64]


class BaselinedPad:
    """drawing: the pad as configured; pad: as mounted. at_rest: whether the baseline recorded the unloaded pad.

    Without rest, the moment and its drift are unknown: frames are then solved with the paper's method and its dipole.
    on_hand: whether the pad is on a hand whose posture changes its field.
    repeats_allowed (N, 3): see `fmfts.pose.repeats_allowed`. change_error (8, 5, M): see `Mounting.change_error`.
    """

    def __init__(
        self,
        drawing: Pad,
        baseline: Baseline,
        mounting: Mounting,
        tracking: TrackingModel,
        on_hand: bool = False,
    ) -> None:
        recorded = baseline.rest or baseline.bare
        assert recorded is not None  # mountings are computed only from such baselines
        self.drawing = drawing
        self.baseline = baseline
        self.mounting = mounting
        self.at_rest = baseline.rest is not None
        self._posture = baseline.posture if on_hand else None
        pad = mounting.mounted(drawing)
        self.pad = pad if self.at_rest else replace(pad, magnet=replace(pad.magnet, as_cylinder=False))
        self.temperature_c = recorded.temperature_c if self.at_rest else None
        self.tracking = tracking if self.at_rest else PAPER
        self.magnet_off_m = (mounting.rest.position_m - drawing.rest_position_m)[:2]
        self.repeats_allowed = repeats_allowed(mounting.noise_t, drawing.chip.coarseness_t(recorded.gain_code))
        self.change_error = mounting.change_error(self.tracking.estimated)
        self._nominal = NominalFrame(mounting.rest, drawing, pad_turn=mounting.pad_turn)

    @classmethod
    def of(
        cls,
        drawing: Pad,
        baseline: Baseline,
        tracking: TrackingModel,
        mounting: Mounting | None = None,
        on_hand: bool = False,
    ) -> BaselinedPad:
        """mounting: computed from the baseline if None. BaselineError if the baseline does not fit the pad."""
        return cls(drawing, baseline, mounting or baseline.mounting(drawing), tracking, on_hand)

    def hidden_gradient(self) -> HiddenGradient:
        mounting, solved = self.mounting, self.tracking.estimated
        effect = effect_of_gradient(self.pad, mounting.rest, mounting.noise_t, solved)
        reference = self._earth() if self.tracking.ambient_turns else STANDS_STILL
        error, posture = mounting.ambient_error(solved), self._posture
        even_t = EVEN_T if posture is None else float(root_of_squares(EVEN_T, posture.even_t))
        return HiddenGradient(self.pad, mounting.rest, reference, error, effect, even_t)

    def to_pose(self) -> Array:
        """(5, 3N) derivative of a frame's pose at rest by each value of the field."""
        mounting = self.mounting
        return effect_of_field(self.pad, mounting.rest, mounting.noise_t, self.tracking.estimated)

    def _earth(self) -> Reference:
        mounting, turn = self.mounting, self.baseline.turn
        if turn is None:
            return reference_of(self.pad, None if mounting.ambient_t is None else mounting.offset_t, None)
        # An error of `offset_t` is in both, so it cancels in their difference.
        turned_t = turn.turn().field_t / mounting.gain - mounting.rest_field_t
        return reference_of(self.pad, mounting.offset_t, turned_t)

    def in_nominal_frame(self, estimate: PoseEstimate) -> tuple[Array, Array, Array]:
        """This pad's change of pose, applied to the drawing's rest: position (3,) m, axis (3,), covariance (6, 6)."""
        return self._nominal.pose(estimate)

    def resting_covariance(self) -> Array | None:
        """Covariance (6, 6) of one frame's pose at rest, in the nominal frame; None if there is no such pose."""
        resting = self.resting(self.mounting.systematic_t)
        return None if resting is None else self.in_nominal_frame(resting)[2]

    def resting(self, systematic_t: Array | float = 0.0) -> PoseEstimate | None:
        """The pose of one frame at rest, with noise and these deviations (N, 3); None if there is no such pose."""
        if not self.at_rest:
            return None
        deviation_t = root_of_squares(self.mounting.noise_t, systematic_t)
        field_t, rest = self.mounting.rest_field_t, self.mounting.rest
        estimate = solve(field_t, self.pad, rest, deviation_t=deviation_t, free=self.tracking.estimated)
        return estimate if estimate.status is Status.CONVERGED else None

    @property
    def lifted_reason(self) -> str:
        """The `reason` of messages while the magnet is above its recorded rest."""
        return (
            f"the magnet is above the rest that baseline {self.baseline.id} recorded, and no press lifts it: the "
            "baseline was recorded under load: record it again while nothing touches the pad; or something pulls at it "
            "and this ends by itself when it lets go"
        )
