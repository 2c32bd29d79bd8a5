"""The problem and the solution of the solver."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Magnet, SensorArray
from fmfts.pose.state import COLUMN_NAMES, NEIGHBOUR_SIZE, SIZE, State

Array = NDArray[np.float64]
Parts = NDArray[np.uint8]

# One measurement is a scalar: `value` (T) is what a sensor at `place` (m) reads along the unit vector `direction`.
# Its standard deviation is hypot(noise in T, proportional·|value|). It was sampled `age` s before the state's time.
PLACE = slice(0, 3)
DIRECTION = slice(3, 6)
VALUE = 6
NOISE = 7
PROPORTIONAL = 8
AGE = 9
MEASUREMENT = 10

# Stop if one more step would lower χ² by less than this: the rest is a thirtieth of a standard deviation.
STOP_CHI2 = 1e-3
# Only rounding is below this: for comparisons between solvers, not for frames.
STOP_CONVERGED = 1e-20
MAX_ITERATIONS = 50


class Part(IntEnum):
    """How one column of the state enters a solve.

    FIXED: keeps the start's value, without error. FREE: estimated from the measurements alone. PRIOR: estimated from
    measurements and prior. CONSIDERED (Schmidt): keeps the start's value, whose error the measurements do not reduce;
    it counts in the covariance of the estimated parts.
    """

    FIXED = 0
    FREE = 1
    CONSIDERED = 2
    PRIOR = 3


class Status(str, Enum):
    """How a solve ended; only CONVERGED is a minimum. UNOBSERVABLE: the measurements do not determine the unknowns."""

    CONVERGED = "converged"
    AT_LIMIT = "at limit"
    UNOBSERVABLE = "unobservable"
    INVALID = "invalid input"


@dataclass(frozen=True, slots=True)
class Prior:
    """A Gaussian: covariance (columns, columns) of a step from `mean`, in the tangent planes of its axes.

    Only rows and columns of parts that are PRIOR or CONSIDERED are read.
    """

    mean: State
    covariance: Array


@dataclass(frozen=True, slots=True)
class Motion:
    """How the state moved since the samples were taken. rate (columns,): known, step per second; a sample is predicted
    at the state's time minus its age, to first order. diffusion (columns,): variance per second of the unknown part."""

    rate: Array
    diffusion: Array


@dataclass(frozen=True, slots=True)
class Problem:
    """measurements (rows, 10): see PLACE … AGE. Rows with a NaN or infinite value, or infinite noise, are left out.

    magnets (1 + neighbours, 2): strength B_T in T·m³ at log moment 0, and κ in m² (0: a dipole). parts (columns,):
    `Part` of each column. project: start from the position alone (see fmfts.pose.acquisition).
    """

    measurements: Array
    magnets: Array
    parts: Parts
    start: State
    prior: Prior | None = None
    motion: Motion | None = None
    stop_chi2: float = STOP_CHI2
    max_iterations: int = MAX_ITERATIONS
    project: bool = False


@dataclass(frozen=True, slots=True)
class Solution:
    """The most probable state.

    covariance (columns, columns): of a step from `state`; zero for fixed parts, the prior's for considered ones. chi2:
    sum of squared misfits in deviations, of measurements and prior, at the most probable value of considered parts.
    rows: number of measurements used. unknowns: number of FREE parts; the expected chi2 is rows − unknowns. residual_t:
    root mean square of the residuals. Unless the status is CONVERGED or AT_LIMIT, all these are NaN, and `state` is
    where the search ended. direction (columns,): if UNOBSERVABLE, the step that changes no measurement, in units of
    each column's deviation if the others were known; else NaN.
    """

    state: State
    covariance: Array
    chi2: float
    rows: int
    unknowns: int
    residual_t: float
    iterations: int
    status: Status
    direction: Array

    @property
    def degrees_of_freedom(self) -> int:
        return self.rows - self.unknowns

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Names of the columns that cannot be separated, the strongest first; empty if all are observable."""
        share = np.abs(self.direction)
        strongest = np.argsort(-np.nan_to_num(share))
        return tuple(column_name(int(column)) for column in strongest if share[column] > 0.1)


def column_name(column: int) -> str:
    if column < SIZE:
        return COLUMN_NAMES[column]
    neighbour, own = divmod(column - SIZE, NEIGHBOUR_SIZE)
    return f"{COLUMN_NAMES[own]} of neighbour {neighbour + 1}"


def measurement_rows(
    field_t: Array,
    sensors: SensorArray,
    deviation_t: Array | float,
    proportional: float = 0.0,
    age_s: Array | float = 0.0,
) -> Array:
    """Measurements (3N, 10) of the fields (N, 3) T in each sensor's own axes. age_s (N,): age of each sample."""
    rows = np.empty((len(sensors), 3, MEASUREMENT))
    rows[:, :, PLACE] = sensors.position_m[:, None]
    rows[:, :, DIRECTION] = sensors.axes.transpose(0, 2, 1)
    rows[:, :, VALUE] = field_t
    rows[:, :, NOISE] = deviation_t
    rows[:, :, PROPORTIONAL] = proportional
    rows[:, :, AGE] = np.asarray(age_s)[..., None]
    return rows.reshape(-1, MEASUREMENT)


def magnet_rows(*magnets: Magnet, octupole: bool | None = None) -> Array:
    """Strength and κ (len(magnets), 2). octupole: True treats all as cylinders, False as dipoles, None each as
    described."""
    if octupole is not None:
        magnets = tuple(replace(magnet, as_cylinder=octupole) for magnet in magnets)
    return np.array([(magnet.strength_t_m3, magnet.modelled_octupole_m2) for magnet in magnets])


def parts_of(columns: int = SIZE, *, free: object = (), considered: object = (), prior: object = ()) -> Parts:
    """Parts (columns,): FIXED, except the columns given by an index, a slice or an array of indices."""
    parts = np.zeros(columns, dtype=np.uint8)
    for part, which in ((Part.FREE, free), (Part.CONSIDERED, considered), (Part.PRIOR, prior)):
        if isinstance(which, slice | int):
            parts[which] = part
        else:
            parts[np.asarray(which, dtype=np.intp)] = part
    return parts
