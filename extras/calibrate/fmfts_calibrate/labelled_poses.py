"""Solves the poses of a calibration set, and fits the pad's smooth response to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fmfts.contact.response import Response
from fmfts_calibrate.dataset import CalibrationSet, rest_field
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.fitting import best_roughness, fit_response
from fmfts_calibrate.left_out import LeftOut
from fmfts_calibrate.tracked import FrameSolver, Scene, Tracked, UnsolvedError

# Largest rms residual of left-out presses, in deviations of a frame's noise: with more, the set does not determine the
# response, or its labels are wrong. Labels exact to 0.1 mm and 1 % of the force give 4.9.
LARGEST_LEFT_OUT = 8.0
# Largest residual of a field of this pad: the noise is 0.2 µT, the dipole's error as much.
LARGEST_RESIDUAL_T = 5e-6
# Largest ambient field left in the set: a baseline without a bare recording leaves 3 µT; the Earth's field is 50 µT.
LARGEST_COMMON_UT = 10.0
Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class LabelledPoses:
    """A set with its poses, and the response fitted to them, with shear if the set has it."""

    calibration: CalibrationSet
    solver: FrameSolver
    tracked: Tracked
    roughness: float
    response: Response
    left_out: LeftOut

    @classmethod
    def of(cls, path: str, calibration: CalibrationSet, solver: FrameSolver, say: Say) -> LabelledPoses:
        """Solve and fit a set. path: names the set in errors. Raises DataError for a field not of this pad."""
        say(f"{path}: solving {len(calibration.press)} poses; magnet of {solver.remanence_t:.4f} T")
        tracked = solved(path, calibration, solver)
        change = tracked.pose[:, :5] - solver.rest_pose[:5]
        say("fitting the pad's response")
        roughness = best_roughness(calibration.press, change, tracked.deviation)
        response = fit_response(calibration.press, change, tracked.deviation, roughness)
        left_out = LeftOut.of(calibration.press, change, tracked.deviation, roughness)
        say(f"presses left out of the fit differ from it by {left_out.in_deviations:.2g} deviations of a frame's noise")
        if left_out.in_deviations > LARGEST_LEFT_OUT:
            raise DataError(
                f"{path}: {len(calibration.press)} presses do not determine this pad's response: presses left out of "
                f"its fit differ from it by {left_out.in_deviations:.3g} deviations of a frame's noise, "
                f"{LARGEST_LEFT_OUT:g} are allowed: press more places (every 2 mm) and forces, or check the labels"
            )
        return cls(calibration, solver, tracked, roughness, response, left_out)


def solver_of(calibration: CalibrationSet, scene: Scene, noise_t: float) -> FrameSolver:
    """The solver of the set's poses."""
    return FrameSolver(calibration.pad, rest_field(calibration), scene, noise_t, calibration.mounting)


def solved(path: str, calibration: CalibrationSet, solver: FrameSolver) -> Tracked:
    """The set's poses. Raises DataError, which names the row, for a field that no magnet of this pad explains."""

    def refusal(row: int, left: str) -> DataError:
        return DataError(
            f"{path}: row {calibration.line[row]}, columns b1x_ut …: no magnet of this pad explains the field{left}: "
            "are the sensors in the config's order, is the ambient field subtracted?"
        )

    try:
        tracked = solver.solved(calibration.field_t, calibration.bound_t)
    except UnsolvedError as error:
        raise refusal(error.row, "") from error
    worst = int(np.argmax(tracked.residual_t))
    if not tracked.residual_t[worst] <= LARGEST_RESIDUAL_T:
        raise refusal(worst, f" ({tracked.residual_t[worst] * 1e6:.1f} µT are left)")
    if calibration.mounting is None:
        _require_subtracted(path, calibration, solver)
    return tracked


def _require_subtracted(path: str, calibration: CalibrationSet, solver: FrameSolver) -> None:
    """Checks that the ambient field was subtracted: the solver's unknowns absorb it, but rest pose and moment, which
    were estimated with it, are wrong."""
    common_ut = solver.common_field_t(calibration.field_t[::8]) * 1e6
    if np.abs(common_ut).max() > LARGEST_COMMON_UT:
        shared = ", ".join(f"{value:.0f}" for value in common_ut)
        raise DataError(
            f"{path}: columns b1x_ut …: in most rows all sensors share ({shared}) µT, as an ambient field does: "
            "subtract it, or give the recorded baseline with --baseline"
        )
