"""Penalised splines over the coordinates of a contact."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from fmfts.pad import Array
from fmfts_skin.field_response import Axis

# No load means no change: such a row counts this many times as much as a row of a press, and each press gets this many
# of them.
REST_COUNTS, REST_SHARE = 25.0, 0.1


class SplineFit:
    """Penalised least squares: third differences of the coefficients along each axis cost `roughness`.

    unloaded: the load, on the last axis, at which nothing changes; None: no coordinate is a load.
    """

    def __init__(self, axes: tuple[Axis, ...], roughness: float, unloaded: float | None) -> None:
        self.axes = axes
        self.penalty = roughness * _differences([axis.cells + 3 for axis in axes])
        self._anchor = None if unloaded is None else self.basis(_unloaded(axes, unloaded))

    def basis(self, contact: Array) -> Array:
        """(K, numbers)."""
        out = np.ones((len(contact), 1))
        for number, axis in enumerate(self.axes):
            cell, values, _ = axis.stencil(contact[:, number])
            along = np.zeros((len(contact), axis.cells + 3))
            np.put_along_axis(along, cell[:, None] + np.arange(4), values, axis=1)
            out = (out[:, :, None] * along[:, None, :]).reshape(len(contact), -1)
        return out

    def of(self, contact: Array, target: Array) -> Array:
        """(numbers, P)."""
        basis = self.basis(contact)
        normal = basis.T @ basis
        # Relative to the weight of the rows, so that `roughness` does not depend on their number.
        scale = np.trace(normal) / len(normal)
        normal += scale * (self.penalty + 1e-9 * np.eye(len(normal)))
        if self._anchor is not None:
            weight = REST_COUNTS * REST_SHARE * len(contact) / len(self._anchor)
            normal += weight * self._anchor.T @ self._anchor
        coefficient: Array = scipy.linalg.solve(normal, basis.T @ target, assume_a="pos")
        return coefficient


def _unloaded(axes: tuple[Axis, ...], load: float) -> Array:
    """Contacts without load, all over the places."""
    lines = [axis.first + axis.spacing * np.arange(axis.cells + 1) for axis in axes[:-1]]
    lines.append(np.full(1, load))
    return np.stack([one.ravel() for one in np.meshgrid(*lines, indexing="ij")], axis=1)


def _differences(sizes: list[int]) -> Array:
    """The quadratic form of third differences along each axis."""
    total: Array = np.zeros((int(np.prod(sizes)),) * 2)
    for along in range(len(sizes)):
        form: Array = np.ones((1, 1))
        for axis, size in enumerate(sizes):
            third = np.diff(np.eye(size), 3, axis=0)
            form = np.asarray(np.kron(form, third.T @ third if axis == along else np.eye(size)), dtype=np.float64)
        total += form
    return total
