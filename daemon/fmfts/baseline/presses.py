"""Unlabelled presses: each has its own unknown pose, and all share the sensors and the magnet."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import cholesky, product, solve_lower
from fmfts.baseline.bundle import Reduced
from fmfts.baseline.unknowns import STANDING_AMBIENT_T, Unknowns
from fmfts.pose import State
from fmfts.pose.state import turned

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Presses:
    """change_t (K, N, 3): change of the field from rest, in sensor axes; each has deviation_t (N, 3).

    start: rough poses, from which the search starts. place_m (N, 3): the same of the sensors, None: the drawing's.
    """

    change_t: Array
    deviation_t: Array
    start: tuple[State, ...]
    place_m: Array | None = None


@dataclass
class PressBundle:
    """The presses within the search for a mounting: updates their poses along with the shared unknowns."""

    presses: Presses
    unknowns: Unknowns
    poses: list[State] = field(init=False)
    reduced: Reduced = field(init=False)

    def __post_init__(self) -> None:
        self.poses = list(self.presses.start)

    def linearise(self, scaled: Array) -> Reduced:
        """The linear equations around the unknowns `scaled` (M,) and the present poses.

        They compare changes from rest: a part of the field at rest that no parameter explains then cancels.
        """
        rest, places, matrix = self.unknowns.unpack(scaled)
        cylinder = self.unknowns.cylinder_m2
        at_rest, rest_columns = self.unknowns.predict(rest, places, matrix, octupole_m2=cylinder)
        whiten = self._whitening(matrix)
        own, shared, residual = [], [], []
        for pose, change in zip(self.poses, self.presses.change_t, strict=True):
            state = replace(rest, position_m=pose.position_m, axis=pose.axis)
            there, columns = self.unknowns.predict(state, places, matrix, pose.axis, cylinder)
            own.append(product(whiten, columns[:, :5]))
            columns[:, :5] = 0.0
            shared.append(product(whiten, (columns - rest_columns) * self.unknowns.deviation))
            residual.append(product(whiten, (change - (there - at_rest)).ravel()))
        self.reduced = Reduced.of(np.array(own), np.array(shared), np.array(residual))
        return self.reduced

    def follow(self, step: Array) -> None:
        """Move every pose by the step that belongs to a step (M,) of the shared unknowns."""
        self.poses = [
            replace(pose, position_m=pose.position_m + own[:3], axis=turned(pose.axis, own[3:]))
            for pose, own in zip(self.poses, self.reduced.own_steps(step), strict=True)
        ]

    def _whitening(self, matrix: Array) -> Array:
        """(3N, 3N) matrix that whitens the errors of a change (noise, ambient field)."""
        to_sensor = self.unknowns.pad.sensors.axes.transpose(0, 2, 1)
        ambient = product(matrix, to_sensor).reshape(-1, 3) * STANDING_AMBIENT_T
        variance = (square(self.presses.deviation_t)).ravel() + square(self.unknowns.model_deviation_t)
        whitening: Array = solve_lower(cholesky(np.diag(variance) + product(ambient, ambient.T)), np.eye(len(variance)))
        return whitening
