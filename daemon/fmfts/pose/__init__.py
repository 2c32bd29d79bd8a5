"""Field → pose: where the magnet is, how it points, how strong it is, and how sure that is."""

from fmfts.pose.dipole import dipole_derivatives, dipole_field
from fmfts.pose.solver import (
    FREE_FIELD,
    FREE_PAPER,
    FREE_POSE,
    STOP_CONVERGED,
    PoseEstimate,
    Status,
    solve,
    solve_batch,
)
from fmfts.pose.state import State, tangent_basis

__all__ = [
    "FREE_FIELD",
    "FREE_PAPER",
    "FREE_POSE",
    "STOP_CONVERGED",
    "PoseEstimate",
    "State",
    "Status",
    "dipole_derivatives",
    "dipole_field",
    "solve",
    "solve_batch",
    "tangent_basis",
]
