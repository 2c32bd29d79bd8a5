"""Field → pose: where the magnet is, how it points, how strong it is, and how uncertain all that is."""

from fmfts.pose.acquisition import Acquired, acquire
from fmfts.pose.alignment import Aligned, Alignment, repeats_allowed
from fmfts.pose.change import change_since
from fmfts.pose.dipole import dipole_derivatives, dipole_field, octupole_m2
from fmfts.pose.field_errors import FieldErrors, SensorErrors
from fmfts.pose.kernel import Batch, solve_problem
from fmfts.pose.problem import STOP_CHI2, STOP_CONVERGED, Motion, Part, Prior, Problem, Solution, Status, parts_of
from fmfts.pose.solver import FREE_FIELD, FREE_PAPER, FREE_POSE, PoseEstimate, solve
from fmfts.pose.state import AMBIENT, AXIS, LOG_MOMENT, POSITION, SIZE, State, tangent_basis
from fmfts.pose.tracking_model import PAPER, TrackingModel

__all__ = [
    "AMBIENT",
    "AXIS",
    "FREE_FIELD",
    "FREE_PAPER",
    "FREE_POSE",
    "LOG_MOMENT",
    "PAPER",
    "POSITION",
    "SIZE",
    "STOP_CHI2",
    "STOP_CONVERGED",
    "Acquired",
    "Aligned",
    "Alignment",
    "Batch",
    "FieldErrors",
    "Motion",
    "Part",
    "PoseEstimate",
    "Prior",
    "Problem",
    "SensorErrors",
    "Solution",
    "State",
    "Status",
    "TrackingModel",
    "acquire",
    "change_since",
    "dipole_derivatives",
    "dipole_field",
    "octupole_m2",
    "parts_of",
    "repeats_allowed",
    "solve",
    "solve_problem",
    "tangent_basis",
]
