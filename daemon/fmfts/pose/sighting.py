"""The last estimate of a pad's magnets, which its neighbours use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.common.record import Field, Record
from fmfts.pad import Array, Magnet, Pad
from fmfts.pose.state import NEIGHBOUR_SIZE, NEIGHBOUR_VALUES, Neighbour, State

COLUMNS = NEIGHBOUR_SIZE

Where = Sequence[Neighbour | State]  # one for each magnet


@dataclass(slots=True)
class SightingMemory:
    """values (M, 7): position, axis and log moment of each magnet. covariance (6M, 6M), time_ns: as in `Sighting`."""

    values: Array
    covariance: Array
    time_ns: int | None


def sighting_fields(magnets: int) -> list[Field]:
    """The fields of a Sighting; C takes them in this order (beside.h)."""
    return [
        ("last", "<f8", NEIGHBOUR_VALUES * magnets),
        ("covariance", "<f8", COLUMNS * magnets * COLUMNS * magnets),
        ("time_ns", "<f8", 0),
        ("rest", "<f8", NEIGHBOUR_VALUES * magnets),
        ("rest_error", "<f8", 2 * magnets),
    ]


class Sighting:
    """Where a pad's M magnets were last estimated, in the pad's own axes. covariance (6M, 6M): of a step from there.

    time_ns: when, on the host's clock; None if never: the magnets are then assumed at rest. rest_error (M, 2): the
    baseline's uncertainty, which `covariance` does not include: deviations of each magnet's place in m, and of its
    field as a share. table: all values, shared with C.
    """

    def __init__(
        self,
        magnets: tuple[Magnet, ...],
        rest: Where,
        last: Where,
        covariance: Array,
        rest_error: Array,
        time_ns: int | None = None,
    ) -> None:
        self.magnets, self.table = magnets, Record(sighting_fields(len(magnets)))
        self.rest, self.last, self.covariance = rest, last, covariance
        self.rest_error, self.time_ns = rest_error, time_ns

    @classmethod
    def unseen(cls, pad: Pad) -> Sighting:
        """For the pad as drawn."""
        others = (Neighbour(one.rest_position_m, one.rest_axis, 0.0) for one in pad.other_magnets)
        rest: Where = (State.at_rest(pad), *others)
        count = len(pad.magnets)
        covariance = np.zeros((COLUMNS * count, COLUMNS * count))
        return cls(tuple(one.magnet for one in pad.magnets), rest, rest, covariance, np.zeros((count, 2)))

    @property
    def last(self) -> Where:
        return self._where("last")

    @last.setter
    def last(self, where: Where) -> None:
        self.table.put("last", values_of(where))

    @property
    def rest(self) -> Where:
        return self._where("rest")

    @rest.setter
    def rest(self, where: Where) -> None:
        self.table.put("rest", values_of(where))

    @property
    def covariance(self) -> Array:
        return self.table["covariance"].reshape(2 * (COLUMNS * len(self.magnets),)).copy()

    @covariance.setter
    def covariance(self, covariance: Array) -> None:
        self.table.put("covariance", covariance)

    @property
    def rest_error(self) -> Array:
        return self.table["rest_error"].reshape(-1, 2).copy()

    @rest_error.setter
    def rest_error(self, rest_error: Array) -> None:
        self.table.put("rest_error", rest_error)

    @property
    def time_ns(self) -> int | None:
        time_ns = self.table.number("time_ns")
        return None if np.isnan(time_ns) else int(time_ns)

    @time_ns.setter
    def time_ns(self, time_ns: int | None) -> None:
        self.table.put("time_ns", np.nan if time_ns is None else float(time_ns))

    def rests(self, rest: Where, rest_error: Array | None = None) -> None:
        """Restart from the rest state of a new baseline."""
        self.rest = self.last = rest
        self.covariance, self.time_ns = np.zeros(self.covariance.shape), None
        self.rest_error = np.zeros(self.rest_error.shape) if rest_error is None else rest_error

    def saw(self, last: Where, covariance: Array, time_ns: int) -> None:
        """covariance (6M, 6M): of a step from `last`."""
        self.last, self.covariance, self.time_ns = last, covariance, time_ns

    @property
    def memory(self) -> SightingMemory:
        return SightingMemory(values_of(self.last), self.covariance, self.time_ns)

    def recall(self, memory: SightingMemory) -> None:
        self.table.put("last", memory.values)
        self.covariance, self.time_ns = memory.covariance, memory.time_ns

    def _where(self, part: str) -> Where:
        return where_of(self.table[part].reshape(-1, NEIGHBOUR_VALUES).copy())


def where_of(values: Array) -> tuple[Neighbour, ...]:
    """The inverse of `values_of`."""
    return tuple(Neighbour(one[:3], one[3:6], float(one[NEIGHBOUR_VALUES - 1])) for one in values)


def values_of(where: Where) -> Array:
    """(M, 7) position, axis and log moment of each magnet."""
    return np.array([np.concatenate([one.position_m, one.axis, [one.log_moment]]) for one in where])
