"""One pad whose magnets are unknown: field → contact, by a table from contact to field (field_response.py).

The change of the field since the rest recording is compared with what each contact of the table causes. Its errors are
the table's own covariance, the moment of all magnets, the ambient field in which the robot turns, and the slow drift of
the rest. A contact that was there is followed from frame to frame; a new one is searched in the whole table.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fmfts.arithmetic.matrix import cholesky, product, solve_lower
from fmfts.common.chi2 import quantile
from fmfts_skin.field_contact import ContactFinder, FoundContacts
from fmfts_skin.field_response import FieldResponse
from fmfts_skin.rested import FREE_FIELD, REST_UT, Array, Mask, RestedPad, SkinReading, health_of

MICROTESLA = 1e6  # units of a tesla: the table's fields are in µT
# A frame is rejected if only one in this many healthy frames has a larger χ².
UNEXPLAINED = 1e-6
# The first contact may be anywhere, so the search starts from as many places as contacts can be distinguished.
PLACES = 50
SPARE = 3  # values that are needed to detect an error
BESIDE = 1e-3  # share of a cell: a contact this near to the table's end is taken to lie beyond it


@dataclass(frozen=True, slots=True)
class _Values:
    """The parts that a set of values needs: the finder of their table, and the root of their covariance without a
    contact."""

    finder: ContactFinder
    root_at_rest: Array


@dataclass
class SkinEstimator(RestedPad):
    """Field → contact."""

    response: FieldResponse
    _known: dict[bytes, _Values] = field(init=False, default_factory=dict)
    untold = "the remaining sensors do not determine the contact"

    def __post_init__(self) -> None:
        unknowns = len(self.response.axes)
        self.watch(unknowns, PLACES)
        self._fewest = unknowns + FREE_FIELD + SPARE
        self._cell = np.array([axis.spacing for axis in self.response.axes])

    def _judged(self, field_t: Array, used: Mask, told: list[str]) -> SkinReading:
        if used.sum() < self._fewest:
            only = f"only {int(used.sum())} values are left, and a contact needs {self._fewest}"
            return self._none("lost", "; ".join([only, *told]), used)
        memory, known = self.memory, self._in_posture(self._of(used), used)
        change_ut = self._change_ut(field_t)[used.ravel()]
        white = solve_lower(known.root_at_rest, change_ut)
        untouched = float(product(white, white))
        needed = self._needed_chi2
        found = None if untouched <= needed else self._found(known.finder, change_ut)
        if found is None or untouched - found.chi2[0] <= needed:
            memory.touching = False
            if untouched > quantile(UNEXPLAINED, len(change_ut) - FREE_FIELD):
                return self._unexplained(untouched, used)
            return SkinReading(*health_of(bool(used.all()), told), used, touching=False)
        if found.chi2[0] > self._limit(change_ut):
            return self._unexplained(float(found.chi2[0]), used)
        memory.touching, memory.contact = True, found.contact[0]
        beyond = self._is_beyond(found.contact[0])
        return SkinReading(*health_of(bool(used.all()), told), used, True, found.contact[0], found.deviation[0], beyond)

    def _change_ut(self, field_t: Array) -> Array:
        """(3N,) the change of the field since the rest recording, at that recording's temperature."""
        whole_t = np.where(np.isfinite(field_t), field_t, 0.0)
        change: Array = (self._as_at_rest(whole_t) - self.mounting.rest_t).ravel() * MICROTESLA
        return change

    def _found(self, finder: ContactFinder, change_ut: Array) -> FoundContacts:
        """Follows the last frame's contact, and searches the table if that no longer explains the frame."""
        if self.memory.touching:
            found = finder.find(change_ut[None], self.memory.contact[None])
            if found.chi2[0] <= self._limit(change_ut):
                return found
        return finder.find(change_ut[None])

    def _limit(self, change_ut: Array) -> float:
        return quantile(UNEXPLAINED, len(change_ut) - FREE_FIELD - len(self._cell))

    def _unexplained(self, chi2: float, used: Mask) -> SkinReading:
        reason = (
            f"no contact of the table explains the field (χ² = {chi2:.0f}): steel or a magnet nearby, a bad chip, a "
            "press that the pad was not calibrated for, or a rest that is no longer so: `fmfts-daemon baseline --rest`"
        )
        return self._none("disturbed", reason, used)

    def _is_beyond(self, contact: Array) -> bool:
        axes = self.response.axes
        near = BESIDE * self._cell
        first, last = np.array([axis.first for axis in axes]), np.array([axis.last for axis in axes])
        outside = (contact <= first + near) | (contact >= last - near)
        return bool(contact[-1] > last[-1] or outside[:-1].any())

    def _in_posture(self, known: _Values, used: Mask) -> _Values:
        """Adds the errors of this frame's posture, if the pad is part of a hand that moves."""
        if self._foreign_t2 is None:
            return known
        values = np.flatnonzero(used.ravel())
        also = MICROTESLA * MICROTESLA * self._foreign_t2[np.ix_(values, values)]
        finder = known.finder.beside(also)
        return _Values(finder, cholesky(finder.covariance_at(np.zeros(1))[0]))

    def _of(self, used: Mask) -> _Values:
        """Each set of values is prepared once: when a sensor fails again, its set is known."""
        key = used.tobytes()
        if key not in self._known:
            values = np.flatnonzero(used.ravel())
            ambient = self.ambient_t * MICROTESLA * self._by_ambient()[values]
            also = product(ambient, ambient.T) + REST_UT * REST_UT * np.eye(len(values))
            finder = ContactFinder(self.response.only(values), also_ut2=also)
            rest = finder.covariance_at(np.zeros(1))[0]
            self._known[key] = _Values(finder, cholesky(rest))
        return self._known[key]
