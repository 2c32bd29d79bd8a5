"""One pad whose magnets are unknown: field → contact, by a table from contact to field (contact/field_response.py).

The change of the field since the rest recording is compared with what each contact of the table causes. Its errors are
the table's own covariance, the moment of all magnets, the ambient field in which the robot turns, and the slow drift of
the rest. A contact that was there is followed from frame to frame; a new one is searched in the whole table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, cholesky, product, solve_lower
from fmfts.baseline.rest_field import RestField
from fmfts.bus.messages import Health
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad
from fmfts.pose import Aligned
from fmfts_skin.field_contact import ContactFinder, FoundContacts
from fmfts_skin.field_response import FieldResponse

Array = NDArray[np.float64]

MICROTESLA = 1e6  # of a tesla: the table's fields are in µT
# The rest drifts with the silicone's temperature and with what pressed before: of each value.
REST_UT = 5.0
# A frame is not explained when its χ² is larger than one in so many healthy ones has it.
UNEXPLAINED = 1e-6
# The first contact may be anywhere: as many places as contacts can be told apart.
PLACES = 50
FALSE_CONTACTS_PER_HOUR = 1.0
# A contact stays while it lowers χ² by more than this share of what brought it.
KEEPS = 0.5
FREE_FIELD, SPARE = 3, 3  # values that the ambient field takes, and that are needed to notice that something is wrong
BESIDE = 1e-3  # of a cell: so near to the table's end a contact is taken to lie beyond it
LONGEST_GAP_S = 0.05


@dataclass(slots=True)
class SkinMemory:
    """contact (D,): of the last frame, meaningful while `touching`. last_us: the board's time of that frame. last_c:
    the last temperature that was told."""

    contact: Array
    touching: bool = False
    last_us: int | None = None
    last_c: float | None = None

    def see(self, aligned: Aligned, temperature_c: float | None, rate_hz: float) -> None:
        """Note a frame's time and temperature. After a long gap a touch needs an onset again."""
        elapsed_s = aligned.elapsed_s(self.last_us)
        self.last_us = aligned.time_us
        self.last_c = self.last_c if temperature_c is None else temperature_c
        if elapsed_s > max(LONGEST_GAP_S, 2.5 / rate_hz) or aligned.began_anew:
            self.touching = False

    def stronger(self, first_c: float | None, magnet_per_k: float) -> float:
        """How much stronger the magnets are than at the temperature `first_c`, as a factor."""
        return 1.0 if first_c is None or self.last_c is None else 1.0 + magnet_per_k * (self.last_c - first_c)


class SkinReading(NamedTuple):
    """What one frame says. used (N, 3): the axes that it was made from. contact, deviation (D,): of a contact.

    touching: None where it is not known. beyond: the contact lies at the table's end, or beyond it.
    """

    health: Health
    reason: str
    used: NDArray[np.bool_]
    touching: bool | None = None
    contact: Array | None = None
    deviation: Array | None = None
    beyond: bool = False


@dataclass(frozen=True, slots=True)
class _Values:
    """What a set of values needs: the finder of their table, and the root of their covariance without a contact."""

    finder: ContactFinder
    root_at_rest: Array


@dataclass
class SkinEstimator:
    """Field → contact of a pad that has a rest recording.

    ambient_t: by how much the ambient field may differ from the recording's, along each axis. repeats_allowed (N, 3):
    of an axis that is not stuck. magnet_per_k: temperature coefficient of the remanence.
    """

    pad: Pad
    mounting: RestField
    response: FieldResponse
    ambient_t: float
    rate_hz: float
    repeats_allowed: Array
    magnet_per_k: float
    memory: SkinMemory = field(init=False)
    _known: dict[bytes, _Values] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        unknowns = len(self.response.axes)
        self.memory = SkinMemory(np.zeros(unknowns), last_c=self.mounting.temperature_c)
        per_frame = FALSE_CONTACTS_PER_HOUR / (3600.0 * self.rate_hz)
        self._gain = quantile(min(per_frame / PLACES, 0.01), unknowns)
        self._fewest = unknowns + FREE_FIELD + SPARE
        self._cell = np.array([axis.spacing for axis in self.response.axes])
        # Of each value by the ambient field, along the pad's axes: the sensors' own axes.
        self._by_ambient = self.pad.sensors.axes.transpose(0, 2, 1).reshape(-1, FREE_FIELD)

    def forget_touch(self) -> None:
        self.memory.touching = False

    def read(self, aligned: Aligned, temperature_c: float | None, missing: Mapping[int, str]) -> SkinReading:
        """Judge one aligned frame. missing: what is wrong with sensors that cannot be used."""
        memory = self.memory
        memory.see(aligned, temperature_c, self.rate_hz)
        used = np.isfinite(aligned.field_t) & (aligned.repeats <= self.repeats_allowed)
        told = [f"sensor {sensor + 1} is {why}" for sensor, why in missing.items()]
        if used.sum() < self._fewest:
            memory.touching = False
            only = f"only {int(used.sum())} values are left, and a contact needs {self._fewest}"
            return SkinReading("lost", "; ".join([only, *told]), used)
        try:
            return self._judged(self._change_ut(aligned)[used.ravel()], used, told)
        except SingularError:
            memory.touching = False
            return SkinReading("lost", "the sensors that are left do not tell a contact", used)

    def _change_ut(self, aligned: Aligned) -> Array:
        """(3N,) the change of the field since the rest recording, at that recording's temperature."""
        stronger = self.memory.stronger(self.mounting.temperature_c, self.magnet_per_k)
        field_t = np.where(np.isfinite(aligned.field_t), aligned.field_t, 0.0)
        change: Array = (field_t / stronger - self.mounting.rest_t).ravel() * MICROTESLA
        return change

    def _judged(self, change_ut: Array, used: NDArray[np.bool_], told: list[str]) -> SkinReading:
        memory, known = self.memory, self._of(used)
        health: Health = "ok" if used.all() else "degraded"
        reason = "; ".join(told) or ("" if used.all() else "axes are saturated or stuck, and are left out")
        white = solve_lower(known.root_at_rest, change_ut)
        untouched = float(product(white, white))
        needed = self._gain * (KEEPS if memory.touching else 1.0)
        found = None if untouched <= needed else self._found(known.finder, change_ut)
        if found is None or untouched - found.chi2[0] <= needed:
            memory.touching = False
            if untouched > quantile(UNEXPLAINED, len(change_ut) - FREE_FIELD):
                return self._unexplained(untouched, used)
            return SkinReading(health, reason, used, touching=False)
        if found.chi2[0] > self._limit(change_ut):
            memory.touching = False
            return self._unexplained(float(found.chi2[0]), used)
        memory.touching, memory.contact = True, found.contact[0]
        beyond = self._is_beyond(found.contact[0])
        return SkinReading(health, reason, used, True, found.contact[0], found.deviation[0], beyond)

    def _found(self, finder: ContactFinder, change_ut: Array) -> FoundContacts:
        """Follows the last frame's contact, and searches the table where that explains the frame no more."""
        if self.memory.touching:
            found = finder.find(change_ut[None], self.memory.contact[None])
            if found.chi2[0] <= self._limit(change_ut):
                return found
        return finder.find(change_ut[None])

    def _limit(self, change_ut: Array) -> float:
        return quantile(UNEXPLAINED, len(change_ut) - FREE_FIELD - len(self._cell))

    def _unexplained(self, chi2: float, used: NDArray[np.bool_]) -> SkinReading:
        reason = (
            f"no contact of the table explains the field (χ² = {chi2:.0f}): steel or a magnet nearby, a bad chip, a "
            "press that the pad was not calibrated for, or a rest that is no longer so: `fmfts-daemon baseline --rest`"
        )
        return SkinReading("disturbed", reason, used)

    def _is_beyond(self, contact: Array) -> bool:
        axes = self.response.axes
        near = BESIDE * self._cell
        first, last = np.array([axis.first for axis in axes]), np.array([axis.last for axis in axes])
        outside = (contact <= first + near) | (contact >= last - near)
        return bool(contact[-1] > last[-1] or outside[:-1].any())

    def _of(self, used: NDArray[np.bool_]) -> _Values:
        """Each set of values is prepared once: a sensor that fails comes back as a set that is known."""
        key = used.tobytes()
        if key not in self._known:
            values = np.flatnonzero(used.ravel())
            ambient = self.ambient_t * MICROTESLA * self._by_ambient[values]
            also = product(ambient, ambient.T) + REST_UT * REST_UT * np.eye(len(values))
            finder = ContactFinder(self.response.only(values), also_ut2=also)
            rest = finder.covariance_at(np.zeros(1))[0]
            self._known[key] = _Values(finder, cholesky(rest))
        return self._known[key]
