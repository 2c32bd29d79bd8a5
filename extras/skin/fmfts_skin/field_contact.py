"""The most likely contact from the field of a pad whose magnets are unknown, by a table from contact to field.

Every contact of a grid is tried first: the table bends so much that a search from one start ends beside the contact.
Gauss–Newton steps then go on from the best of the grid. Errors count as the table's covariance says at that load; what
the moment of all magnets may have changed since the pad's rest was known is considered with them.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import cholesky, inverse, log_determinant, product, solve, solve_lower
from fmfts_skin.field_response import Array, FieldResponse

# The grid: this many places for each cell of the table along x and y, and this many loads, with and without a place.
PLACES_OF_A_CELL, LOADS_BESIDE_PLACES, LOADS_ALONE = 1.5, 17, 201
STEPS = 15
FIRST_DAMPING, LESS, MORE = 1e-3, 0.1, 10.0
SETTLED, SETTLED_NEAR = 1e-6, 1e-3  # steps, as shares of a cell: after a search, and from a previous contact nearby
# A load may lie beyond the table by this share of its range (the tangent is followed there); below a rest only as
# noise.
BEYOND, BELOW_REST = 1.0, 0.05
# Prior of a place that no value determines: this many cells. It keeps the normal matrix regular.
LOOSE_CELLS = 1e3
FRAMES_AT_ONCE = 500


class FoundContacts(NamedTuple):
    """contact (K, D), covariance (K, D, D) of it, and chi2 (K,) of the values that are left."""

    contact: Array
    covariance: Array
    chi2: Array

    @property
    def deviation(self) -> Array:
        """(K, D)."""
        deviation: Array = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return deviation


class ContactFinder:
    """Finds contacts by the table `response`. moment_share: deviation of the moment; None: the table's own.

    also_ut2 (P, P): covariance of errors besides the table's; None: there are none.
    """

    def __init__(
        self, response: FieldResponse, moment_share: float | None = None, also_ut2: Array | None = None
    ) -> None:
        self.response = response
        share = response.moment_share if moment_share is None else moment_share
        common = share * response.reference_ut
        covariance = response.covariance + common[:, None] * common[None, :]
        self._expect(covariance if also_ut2 is None else covariance + also_ut2)
        self._cell = np.array([axis.spacing for axis in response.axes])
        load = response.axes[-1]
        self._least = np.array([axis.first for axis in response.axes])
        self._most = np.array([axis.last for axis in response.axes])
        self._least[-1] -= BELOW_REST * (load.last - load.first)
        self._most[-1] += BEYOND * (load.last - load.first)
        self._grid = self._contacts()
        self._grid_change = self.response.felt(self._grid).change

    def beside(self, also_ut2: Array) -> ContactFinder:
        """A finder of the same table that allows for more errors, of covariance (P, P)."""
        other = copy(self)
        other._expect(self._covariance + also_ut2)
        return other

    def _expect(self, covariance: Array) -> None:
        self._covariance = covariance
        self._log = np.array([log_determinant(one) for one in covariance])
        self._levels: list[tuple[Array, NDArray[np.intp], Array]] | None = None

    def _contacts(self) -> Array:
        """(G, D): the grid."""
        places = [round(PLACES_OF_A_CELL * axis.cells) + 1 for axis in self.response.axes[:-1]]
        counts = [*places, LOADS_BESIDE_PLACES if places else LOADS_ALONE]
        lines = [
            np.linspace(axis.first, axis.last, count) for axis, count in zip(self.response.axes, counts, strict=True)
        ]
        return np.stack([one.ravel() for one in np.meshgrid(*lines, indexing="ij")], axis=1)

    def _of_level(self) -> list[tuple[Array, NDArray[np.intp], Array]]:
        """For each level of load: the Cholesky root there, the grid's contacts nearest to it, and their fields,
        whitened (P, g)."""
        lower, share = self.response.of_level(self._grid[:, -1])
        nearest = lower + (share > 0.5)
        change = self._grid_change
        out = []
        for level, covariance in enumerate(self._covariance):
            members = np.flatnonzero(nearest == level)
            if len(members):
                root = cholesky(covariance)
                out.append((root, members, solve_lower(root, change[members].T)))
        return out

    def find(self, change_ut: Array, near: Array | None = None) -> FoundContacts:
        """The contacts that explain changes (K, P) of the field, in the table's own scale (`Instance.change_ut`).

        near (K, D): where the search begins; None: everywhere.
        """
        settled, parts = SETTLED if near is None else SETTLED_NEAR, []
        for start in range(0, max(len(change_ut), 1), FRAMES_AT_ONCE):
            some = slice(start, start + FRAMES_AT_ONCE)
            contact = self._scan(change_ut[some]) if near is None else near[some]
            parts.append(self._find(change_ut[some], contact, settled))
        return FoundContacts(*(np.concatenate(one) for one in zip(*parts, strict=True)))

    def _find(self, change_ut: Array, contact: Array, settled: float) -> FoundContacts:
        damping = np.full(len(contact), FIRST_DAMPING)
        cost, white, slope = self._linearised(contact, change_ut)
        for _ in range(STEPS):
            normal, gradient = self._normal(slope), product(slope.swapaxes(1, 2), white[:, :, None])
            size = np.diagonal(normal, axis1=1, axis2=2)
            damped = normal + (damping[:, None] * size)[:, :, None] * np.eye(len(self._cell))
            trial = np.clip(contact + solve(damped, gradient)[:, :, 0], self._least, self._most)
            moved = np.abs((trial - contact) / self._cell).max(axis=1, initial=0.0)
            trial_cost, trial_white, trial_slope = self._linearised(trial, change_ut)
            better = trial_cost < cost
            contact = np.where(better[:, None], trial, contact)
            cost = np.where(better, trial_cost, cost)
            white = np.where(better[:, None], trial_white, white)
            slope = np.where(better[:, None, None], trial_slope, slope)
            damping = damping * np.where(better, LESS, MORE)
            if (moved < settled).all():
                break
        covariance = inverse(self._normal(slope))
        covariance[:, -1, -1] += self.response.load_share * self.response.load_share * contact[:, -1] * contact[:, -1]
        return FoundContacts(contact, covariance, product(white[:, None, :], white[:, :, None])[:, 0, 0])

    def _scan(self, change_ut: Array) -> Array:
        """(K, D): for each frame the most likely contact of the grid."""
        cost = np.empty((len(change_ut), len(self._grid)))
        log = self._log_at(self._grid[:, -1])
        if self._levels is None:
            self._levels = self._of_level()
        for root, members, template in self._levels:
            white = solve_lower(root, change_ut.T)
            size, own = (template * template).sum(axis=0), (white * white).sum(axis=0)
            cost[:, members] = own[:, None] + size - 2.0 * product(white.T, template) + log[members]
        best: Array = self._grid[np.argmin(cost, axis=1)]
        return best

    def _log_at(self, load: Array) -> Array:
        lower, share = self.response.of_level(load)
        upper = np.minimum(lower + 1, len(self._log) - 1)
        log: Array = (1.0 - share) * self._log[lower] + share * self._log[upper]
        return log

    def covariance_at(self, load: Array) -> Array:
        """The covariance (K, P, P) of frames about the table at loads (K,)."""
        lower, share = self.response.of_level(load)
        upper, share = np.minimum(lower + 1, len(self._log) - 1), share[:, None, None]
        return (1.0 - share) * self._covariance[lower] + share * self._covariance[upper]

    def _linearised(self, contact: Array, change_ut: Array) -> tuple[Array, Array, Array]:
        """The cost (K,), residuals (K, P) and slopes (K, P, D), whitened."""
        felt = self.response.felt(contact)
        root = cholesky(self.covariance_at(contact[:, -1]))
        both = np.concatenate([(change_ut - felt.change)[:, :, None], felt.slope], axis=2)
        white = solve_lower(root, both)
        residual, slope = white[:, :, 0], white[:, :, 1:]
        return (residual * residual).sum(axis=1) + self._log_at(contact[:, -1]), residual, slope

    def _normal(self, slope: Array) -> Array:
        """(K, D, D), kept regular if nothing determines a coordinate."""
        loose = LOOSE_CELLS * self._cell
        normal: Array = product(slope.swapaxes(1, 2), slope) + np.diag(1.0 / (loose * loose))
        return normal
