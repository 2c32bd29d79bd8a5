"""How many fingers press: the smallest number that explains the frame, with hysteresis, and which finger is which.

A finger is added where it lowers χ² by more than a threshold, tested with the uncertainty of the earlier fingers
(shear, patch, table: field_model.py), so that a wide or sliding finger does not count as two. A finger is removed when
χ² no longer needs it: its force is near zero, or it is too near to the other one to be distinguished (a wide patch
looks the same).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length
from fmfts.common.chi2 import quantile
from fmfts.several import _several
from fmfts.several.arrays import doubles
from fmfts.several.field_model import FINGER
from fmfts.several.fit import APART_MM, DOUBTFUL, GRID_FORCE_N, Fit, Fitter, Measured

Array = NDArray[np.float64]

MOST_FINGERS = 2
# A second finger must lower χ² by this. None of 300,000 frames of one finger was split; the gain that one in a
# million of them has is 35 at most, on pads whose chips were placed by hand (lab/results/several.md).
SECOND_GAIN = 45.0
# Of an untouched pad. The first finger may be anywhere: as many places as can be distinguished.
FALSE_CONTACTS_PER_HOUR, PLACES = 1.0, 50
SMALLEST_SHARE = 0.05  # a second finger has at least this share of the force
# Without a doubtful finger (too weak, or too near to the other one: fit.py) the frame is fitted again. It stays if χ²
# then rises by more than half of the threshold, is removed at once if by less than a quarter, else after this many
# frames in a row.
KEEPS, RELEASES, RELEASE_FRAMES = 0.5, 0.25, 5

# The state of a frame's search, which is needed if the previous frame's fingers do not explain it: none needed, made,
# or due.
Search = Literal["none", "made", "due"]


@dataclass(slots=True)
class CounterMemory:
    """count: fingers in the last frame. places (MOST_FINGERS, 3): theirs first, in mm and N. ids (MOST_FINGERS,): their
    numbers. next_id: of the next new finger. doubtful_frames: for how many frames in a row one of them has been too
    weak, or two too near.
    """

    count: int = 0
    places: Array = field(default_factory=lambda: np.zeros((MOST_FINGERS, FINGER)))
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(MOST_FINGERS, dtype=np.int64))
    next_id: int = 1
    doubtful_frames: int = 0

    @property
    def fingers(self) -> Array:
        """(count, 3)."""
        return self.places[: self.count]

    @property
    def known(self) -> list[int]:
        """The ids of its fingers."""
        ids: list[int] = self.ids[: self.count].tolist()
        return ids

    def put(self, fingers: Array, ids: Sequence[int], before: Sequence[int]) -> None:
        """In other arrays, so that copies keep theirs. before: the ids that it has."""
        self.count = len(fingers)
        if self.count:
            self.places = self.places.copy()
            self.places[: self.count] = fingers
        if self.count and ids != before:
            self.ids = self.ids.copy()
            self.ids[: self.count] = ids

    def copy(self) -> CounterMemory:
        return CounterMemory(self.count, self.places, self.ids, self.next_id, self.doubtful_frames)


class Counted(NamedTuple):
    """fit: of the fingers that there are. ids: of each. search: for a second finger."""

    fit: Fit
    ids: tuple[int, ...]
    search: Search = "none"


class FingerCounter:
    """Follows the fingers of one pad from frame to frame."""

    def __init__(self, fitter: Fitter, rate_hz: float) -> None:
        self._fitter = fitter
        per_frame = FALSE_CONTACTS_PER_HOUR / (3600.0 * rate_hz)
        self._first_gain = quantile(min(per_frame / PLACES, 0.01), FINGER)
        # With so many fingers, it looks for no other one in a frame of a smaller χ².
        self.searched_from = self._first_gain, SECOND_GAIN, inf
        self.memory = CounterMemory()

    def forget(self) -> None:
        """No finger presses any more, or it is unknown."""
        self.memory.count = self.memory.doubtful_frames = 0

    def detection_limit_n(self, noise_t: Array) -> float:
        """The smallest force (N) that is detected at every place of the table, with noise_t (N, 3) alone."""
        fitter, nobody = self._fitter, np.zeros((0, FINGER))
        quiet = Measured(np.zeros(noise_t.size), (noise_t * noise_t).ravel(), np.ones(noise_t.size, dtype=np.bool_))
        size = fitter.sizes(fitter.whitener(nobody, quiet, np.zeros(3)), quiet)
        return float(GRID_FORCE_N * np.sqrt(self._first_gain / size.min()))

    def update(self, measured: Measured, ambient_t: Array, may_search: bool = True, fit: Fit | None = None) -> Counted:
        """The fingers of the next frame. SingularError where the values determine nothing.

        may_search: it may search for a second finger, which takes ten times as long as the rest. fit: of the fingers of
        before, where it is known.
        """
        memory = self.memory
        fit = self._fitter.fit(memory.fingers, measured, ambient_t) if fit is None else fit
        before = ids = memory.known
        # Another finger lowers χ² by at most all of it.
        nobody, one = not ids, len(ids) == 1
        if nobody and fit.chi2 > self._first_gain and (found := self._first(fit, measured, ambient_t)) is not None:
            fit, ids, memory.doubtful_frames, one = found, [self._new_id()], 0, True
        search: Search = "none"
        if one and fit.chi2 > SECOND_GAIN:
            search = "made" if may_search else "due"
            if may_search and (pair := self._second(fit, measured, ambient_t)) is not None:
                fit, ids, memory.doubtful_frames = pair, self._split(fit, pair, ids[0]), 0
        fit, ids = self._fewer(fit, ids, measured, ambient_t)
        memory.put(fit.fingers, ids, before)
        return Counted(fit, tuple(ids), search)

    def appears(self, measured: Measured, ambient_t: Array) -> Fit | None:
        """One finger, where nothing pressed before; None where none does. Nothing is remembered."""
        nobody = self._fitter.fit(np.zeros((0, FINGER)), measured, ambient_t)
        return self._first(nobody, measured, ambient_t) if nobody.chi2 > self._first_gain else None

    def _first(self, before: Fit, measured: Measured, ambient_t: Array) -> Fit | None:
        root = self._fitter.whitener(before.fingers, measured, ambient_t)
        start, gain = self._fitter.best_single(root, measured)
        return self._fitter.fit(start, measured, ambient_t) if gain > self._first_gain else None

    def _second(self, before: Fit, measured: Measured, ambient_t: Array) -> Fit | None:
        root = self._fitter.whitener(before.fingers, measured, ambient_t)
        starts = self._fitter.best_seconds(root, before.fingers, measured) + self._fitter.best_pairs(root, measured)
        found = [self._fitter.fit(pair, measured, ambient_t) for pair in starts]
        found = [one for one in found if are_two(one.fingers)]
        if not found:
            return None
        best = min(found, key=lambda one: one.chi2)
        gain = before.chi2 - self._fitter.chi2_with(root, best.fingers, measured)
        return best if gain > SECOND_GAIN else None

    def _split(self, one: Fit, pair: Fit, id_of_one: int) -> list[int]:
        """The nearer one of the two keeps the previous finger's id."""
        first, other = (length((finger - one.fingers[0])[:2]) for finger in pair.fingers)
        return [id_of_one, self._new_id()] if first <= other else [self._new_id(), id_of_one]

    def _new_id(self) -> int:
        self.memory.next_id += 1
        return self.memory.next_id - 1

    def _fewer(self, fit: Fit, ids: list[int], measured: Measured, ambient_t: Array) -> tuple[Fit, list[int]]:
        """Remove each finger that the frame does not need, at once or after some frames.

        The deviation of a force alone does not decide: near the table's edge it comes mostly from the place.
        """
        memory = self.memory
        while ids and fit.flags & DOUBTFUL:
            left = resultant(fit.fingers)[None] if len(ids) > 1 else np.zeros((0, FINGER))
            fewer = self._fitter.fit(left, measured, ambient_t)
            lost = (fewer.chi2 - fit.chi2) / (SECOND_GAIN if len(ids) > 1 else self._first_gain)
            memory.doubtful_frames = memory.doubtful_frames + 1 if lost < KEEPS else 0
            if lost >= RELEASES and memory.doubtful_frames < RELEASE_FRAMES:
                return fit, ids
            memory.doubtful_frames = 0
            fit, ids = fewer, [ids[int(np.argmax(fit.fingers[:, 2]))]] if len(ids) > 1 else []
        memory.doubtful_frames = 0
        return fit, ids


def are_two(fingers: Array) -> bool:
    """Whether two fingers (2, 3) are far enough apart, and the weaker one strong enough, to be reported as two."""
    forces = fingers[:, 2]
    apart = length((fingers[0] - fingers[1])[:2]) >= APART_MM
    return bool(apart and forces.min() > SMALLEST_SHARE * forces.sum())


def resultant(fingers: Array) -> Array:
    """(3,) the place where all of the force would press, and its sum."""
    whole = np.empty(FINGER)
    _several.resultant(doubles(fingers), whole, None, None, None)
    return whole
