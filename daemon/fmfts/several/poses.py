"""The poses of a pad's magnets, with their covariance.

The table of presses gives the poses that the fingers cause, but considered causes (shear, patch, the table's errors)
move the magnets, too. The residual determines these. With the fingers x ± Σ, the considered causes p ~ N(0, 1), the
poses A x + B p, and the field J x + P (B p) of covariance C (field_model.py), the most likely poses given the residual
r are

    A x + W r,  W = B B' P' C⁻¹,  with the covariance  B B' − W P B B' + (A − W J) Σ (A − W J)'
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.several import _several
from fmfts.several.arrays import require_room
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Fit, Fitter
from fmfts.several.measured import Measured, refuse

Array = NDArray[np.float64]

# Of each magnet, in m and components of the axis: from undetected fingers, and from silicone that has not recovered yet
# from a press.
UNFELT = np.array([1e-5, 1e-5, 2e-5, 2e-3, 2e-3])


class Poses(NamedTuple):
    """The magnets, and the change (5M,) of their poses since rest, in m and components of the axis. variance (5M,): the
    diagonal of its covariance, which is moves moves' − told told' + by_finger fingers by_finger'; moves, told,
    by_finger (5M, …), fingers (3K, 3K)."""

    magnets: Magnets
    change: Array
    variance: Array
    moves: Array
    told: Array
    by_finger: Array
    fingers: Array

    @property
    def covariance(self) -> Array:
        """(5M, 5M)."""
        own = product(self.moves, self.moves.T) - product(self.told, self.told.T)
        covariance: Array = own + product(self.by_finger, self.fingers, self.by_finger.T)
        return covariance


def poses_of(fitter: Fitter, fit: Fit, measured: Measured, around_t: Array) -> Poses:
    """The magnets of a frame, moved by the fingers and other causes.

    around_t (3,): the change of the field around, as `Fitter.fit` has it.
    """
    model, fingers = fitter.model, len(fit.fingers)
    if not fingers:
        return _untouched(model.mounting.magnets, fit)
    require_room(fingers=fingers)
    rest, unknowns, used = model.mounting.magnets, FINGER * fingers, np.count_nonzero(measured.used)
    count = len(rest)
    poses, causes, places = CHANGE * count, unknowns + 2 * count, (count, 3)
    shapes = poses, places, places, poses, (poses, poses + causes + poses), (poses, used), (poses, unknowns)
    found = [np.empty(shape) for shape in shapes]
    given = fit.fingers, fit.covariance, fit.misfit_t, *measured.arrays[1:], around_t
    wrong, size, _ = _several.poses(*model.parts, UNFELT, *given, *found)
    refuse(wrong, size, measured, fingers=fit.fingers, ambient_t=around_t)
    change, position, axis, variance, moves, told, by_finger = found
    magnets = Magnets(position, axis, rest.strength_t_m3, rest.octupole_m2)
    return Poses(magnets, change, variance, moves, told, by_finger, fit.covariance)


def _untouched(rest: Magnets, fit: Fit) -> Poses:
    """At rest, with the uncertainty of undetected fingers."""
    unfelt, nothing = np.tile(UNFELT, len(rest)), np.zeros((CHANGE * len(rest), 0))
    return Poses(rest, np.zeros(len(unfelt)), square(unfelt), np.diag(unfelt), nothing, nothing, fit.covariance)
