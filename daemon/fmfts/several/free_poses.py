"""The poses of all magnets by the field alone, without a table of presses: damped least squares (arithmetic/descent.h).

The unknowns are the changes of pose since rest, five of each magnet. The ambient field, all moments together and the
baseline's uncertainty are considered, as field_model.py explains, for poses instead of fingers:

    C = noise + A A' σ_A² + m m' σ_m² + E E'

Where several fingers are six unknowns, the poses of four magnets are twenty. So sensors have to give more values:
pose/observable.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline.array_mounting import HALF_A_PRESS
from fmfts.common.chi2 import quantile
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.pose.observable import taken_values
from fmfts.several import _several
from fmfts.several.arrays import doubles
from fmfts.several.field_model import FieldModel, Predicted
from fmfts.several.fit import DAMPING, DAMPING_FACTOR, ITERATIONS, MOST_DAMPING, ROUNDING, SETTLED
from fmfts.several.measured import Measured, refuse
from fmfts.several.odd_sensor import UNEXPLAINED

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# No press moves a magnet farther, in m and components of the axis: a result there is invalid.
FARTHEST = np.array([3e-3, 3e-3, 3e-3, 0.6, 0.6])
HALF_A_PRESS_M = -float(HALF_A_PRESS[2])
# As fit.h has them.
LIMITS = np.array([ITERATIONS, SETTLED, ROUNDING, DAMPING, DAMPING_FACTOR, MOST_DAMPING, HALF_A_PRESS_M, *FARTHEST])


@dataclass(frozen=True, slots=True)
class FreePoses:
    """The magnets; change (5M,): of their poses since rest, in m and components of the axis, with its covariance (5M,
    5M). chi2: of the residual; misfit_t (3N,). ambient_t (3,): the change of the ambient field that goes with it.
    predicted: there; the baseline's errors are proportional to its change."""

    magnets: Magnets
    change: Array
    covariance: Array
    chi2: float
    misfit_t: Array
    ambient_t: Array
    predicted: Predicted

    @property
    def variance(self) -> Array:
        """(5M,)."""
        return np.maximum(np.diagonal(self.covariance), 0.0)

    @property
    def is_farthest(self) -> bool:
        """Whether a magnet is at the limit of the search."""
        return bool((np.abs(self.change.reshape(-1, CHANGE)) >= FARTHEST).any())


def is_explained(poses: FreePoses, used: Mask) -> bool:
    """Whether a healthy frame may have such a χ². used (N, 3): the values that it was made from."""
    freedom = int(np.count_nonzero(used)) - taken_values(len(poses.magnets))
    return poses.chi2 <= quantile(UNEXPLAINED, max(freedom, 1)) and not poses.is_farthest


def free_poses(model: FieldModel, start: Array, measured: Measured, around_t: Array) -> FreePoses:
    """The most likely poses near the change `start` (5M,). SingularError where the values do not determine them.

    around_t (3,): the change of the field around, as `Fitter.fit` has it.
    """
    rest, poses, values = model.mounting.magnets, len(start), len(measured.field_t)
    places = len(rest), 3
    shapes = poses, (poses, poses), values, 3, (values, poses), poses, places, places
    found = [np.empty(shape) for shape in shapes]
    given = LIMITS, doubles(start), *measured.arrays, doubles(around_t)
    wrong, size, chi2 = _several.free_poses(*model.parts, *given, *found)
    refuse(wrong, size, measured, start=start, ambient_t=around_t)
    change, covariance, misfit, ambient, by_pose, counted, position, axis = found
    magnets = Magnets(position, axis, rest.strength_t_m3, rest.octupole_m2)
    predicted = Predicted(measured.field_t - misfit, np.empty((values, 0)), by_pose, counted, ())
    return FreePoses(magnets, change, covariance, chi2, misfit, ambient, predicted)
