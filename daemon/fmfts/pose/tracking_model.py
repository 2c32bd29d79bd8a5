"""Which parts of the state are unknown in a scene, and how they change with time and temperature."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fmfts.pose.problem import Part, Parts, parts_of
from fmfts.pose.solver import FREE_PAPER
from fmfts.pose.state import AMBIENT, SIZE

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrackingModel:
    """Which parts of the state are unknown, and how: see fmfts.pose.problem.Part.

    parts (SIZE,). initial (SIZE,): variance of PRIOR and CONSIDERED parts right after the baseline. walk_per_s (SIZE,):
    growth of that variance per second. moment_per_k, moment_per_k_deviation: change of the log moment per kelvin.
    offset_t_per_k: deviation of the drift of a chip's offset on each axis.
    unread_warming_k: deviation of the pad's warming since the baseline, until a temperature is read. ambient_turns: the
    robot may turn in the ambient field; else only foreign fields change it. steel_nearby: steel or other magnets pass
    the pad.
    """

    parts: Parts
    initial: Array = field(default_factory=lambda: np.zeros(SIZE))
    walk_per_s: Array = field(default_factory=lambda: np.zeros(SIZE))
    moment_per_k: float = 0.0
    moment_per_k_deviation: float = 0.0
    unread_warming_k: float = 0.0
    ambient_turns: bool = True
    offset_t_per_k: float = 0.0
    steel_nearby: bool = False

    @property
    def has_prior(self) -> bool:
        return bool(np.isin(self.parts, (Part.PRIOR, Part.CONSIDERED)).any())

    @property
    def estimated(self) -> NDArray[np.intp]:
        """The columns that a frame estimates, without the gradient."""
        return np.flatnonzero(np.isin(self.parts[: AMBIENT.stop], (Part.FREE, Part.PRIOR)))


# The paper's six unknowns, for a constant ambient field.
PAPER = TrackingModel(parts_of(free=FREE_PAPER))
