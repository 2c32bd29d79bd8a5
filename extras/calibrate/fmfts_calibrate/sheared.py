"""The response of a model that tells shear: to normal forces from one set of presses, to shear from another or from it.

The daemon solves place, force and shear by this response alone (contact/sheared.c). Its network tells no shear.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from fmfts.contact.contract import SHEAR_OUTPUT_ORDER, Envelope, Facts
from fmfts.contact.response import Response
from fmfts.pad import Array
from fmfts_calibrate.dataset import CalibrationSet
from fmfts_calibrate.evaluation import force_bins
from fmfts_calibrate.fitting import shear_alone, with_shear
from fmfts_calibrate.labelled_poses import LabelledPoses, Say, solved, solver_of
from fmfts_calibrate.left_out import LeftOut
from fmfts_calibrate.samples import Samples, presses_in_bins, presses_within
from fmfts_calibrate.tracked import FrameSolver

JUDGED_IN_A_BIN, EXTREMES = 1500, 20000
# A pose is in the envelope of the model if a press with this friction makes it: rubber on most things.
LARGEST_FRICTION = 1.2


@dataclass(frozen=True, slots=True)
class ShearedResponse:
    """left_out: presses that were left out of the fit of what shear adds."""

    response: Response
    left_out: LeftOut

    @classmethod
    def of(
        cls, known: LabelledPoses, sheared: tuple[str, CalibrationSet] | None, noise_t: float, say: Say
    ) -> ShearedResponse:
        """known: the set without shear, whose solver's scene counts. sheared: (path, set) of presses with shear; None:
        `known` has them. Raises DataError for a field not of this pad."""
        if sheared is None:
            return cls(known.response, known.left_out)
        path, calibration = sheared
        normal, solver = known.response.without_shear(), solver_of(calibration, known.solver.scene, noise_t)
        say(f"{path}: solving {len(calibration.press)} poses, and fitting what shear adds")
        tracked = solved(path, calibration, solver)
        rows = calibration.press[:, 3:].any(axis=1)
        press, deviation = calibration.press[rows], tracked.deviation[rows]
        change: Array = tracked.pose[rows, :5] - solver.rest_pose[:5]
        added = change - normal.change(press[:, :3])
        left_out = LeftOut.of(press, added, deviation, known.roughness, shear_alone(normal, press))
        say(f"presses left out of the fit differ from it by {left_out.in_deviations:.2g} deviations of a frame's noise")
        return cls(with_shear(normal, press, added, deviation, known.roughness), left_out)

    def stated_in(self, facts: Facts, solver: FrameSolver) -> Facts:
        """The facts of the network without shear, of a file with this response."""
        response, bins = self.response, force_bins(self.response.scale_n)
        clean = Samples.expected(
            response, solver, presses_in_bins(response, bins, JUDGED_IN_A_BIN, np.random.default_rng(5))
        )
        error = self.left_out.error(response, clean, bins)
        own = msgspec.structs.replace(facts.own_error, shear_error_n=error.shear_error_n)
        return msgspec.structs.replace(
            facts,
            outputs=SHEAR_OUTPUT_ORDER,
            own_error=own,
            response_error=error,
            envelope=self._widened(facts.envelope, solver),
        )

    def _widened(self, envelope: Envelope, solver: FrameSolver) -> Envelope:
        """The envelope with the poses of presses of LARGEST_FRICTION."""
        press = presses_within(self.response, EXTREMES, np.random.default_rng(6), beyond=1.0)
        press[:, 3:] *= LARGEST_FRICTION / self.response.friction
        change = self.response.change(press)
        pose = np.array([envelope.pose_min, envelope.pose_max])
        pose[0, :5] = np.minimum(pose[0, :5], solver.rest_pose[:5] + change.min(axis=0))
        pose[1, :5] = np.maximum(pose[1, :5], solver.rest_pose[:5] + change.max(axis=0))
        return msgspec.structs.replace(envelope, pose_min=tuple(pose[0].tolist()), pose_max=tuple(pose[1].tolist()))
