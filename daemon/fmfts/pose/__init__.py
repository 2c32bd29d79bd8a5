"""Field → pose: where the magnet is, how it points, how strong it is, and how sure that is."""

from fmfts.pose.alignment import Aligned, Alignment
from fmfts.pose.change import as_drawn, displacement, widened
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
from fmfts.pose.tracker import Track, Tracker, TrackHealth

__all__ = [
    "FREE_FIELD",
    "FREE_PAPER",
    "FREE_POSE",
    "STOP_CONVERGED",
    "Aligned",
    "Alignment",
    "PoseEstimate",
    "State",
    "Status",
    "Track",
    "TrackHealth",
    "Tracker",
    "as_drawn",
    "dipole_derivatives",
    "dipole_field",
    "displacement",
    "solve",
    "solve_batch",
    "tangent_basis",
    "widened",
]
