"""The verdict of the check: the board is as drawn, its faults, or the remaining explanations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from fmfts.common.chi2 import quantile
from fmfts_magnet.cost import Description
from fmfts_magnet.readings import AMBIENT_T, Board, Hand, Readings
from fmfts_magnet.search import Found, Search

# An explanation remains possible unless it is twenty times less probable; −2 ln.
ALIKE = 2.0 * log(20.0)
# A simple fault is excluded if the readings alone make it this much less probable.
EXCLUDED = 2.0 * log(30.0)
SAME_READINGS = 0.05
SAME_SCALE = 0.3  # difference of logarithms below which scales count as equal
FALSE_REFUSAL = 1e-6
DETECTED = 10.0  # deviations: a channel or an axis that reads less, where others read more, is dead
LEAST_FIELD_T = 1e-5
FEWEST = 3


class TooLittleError(Exception):
    """The readings are too weak for a verdict; the text says why, and what to do."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """found: the explanations that remain, the most probable first; none where nothing explains the readings.

    blind: explanations that the readings cannot exclude, although the drawing is more probable before them.
    dead: axes (N, 3) that read nothing. worst: the channel that fits worst, if nothing explains the readings.
    layouts: names of published boards that explain the readings without any fault, where the configuration names
    another, or where several do. The most probable is the first, and `board` is its layout.
    """

    board: Board
    readings: Readings
    found: tuple[Found, ...]
    blind: tuple[Found, ...]
    dead: NDArray[np.bool_]
    worst: int | None = None
    layouts: tuple[str, ...] = ()

    @property
    def is_as_drawn(self) -> bool:
        return self.is_decided and self.found[0].description.is_as_drawn and not self.dead.any() and not self.layouts

    @property
    def is_decided(self) -> bool:
        return len(self.found) == 1 and not self.blind and len(self.layouts) < 2

    @property
    def descriptions(self) -> tuple[Description, ...]:
        return tuple(each.description for each in self.found)


def judged(board: Board, readings: Readings, hand: Hand) -> Verdict:
    """Raises TooLittleError if too few sensors measure the magnet."""
    dead = dead_axes(readings)
    used = dead.sum(axis=1) < 2
    if used.sum() < FEWEST:
        raise TooLittleError(
            f"only {used.sum()} of {len(board)} sensors measure the magnet, and {FEWEST} are needed: take a stronger "
            "magnet or hold it lower; `fmfts-daemon probe` says which sensors answer"
        )
    search = _search(board, readings, hand, dead)
    ranked = search.run()
    best = ranked[0]
    if not _is_explained(search, best):
        return Verdict(board, readings, (), (), dead, int(best.fit.by_channel[0].argmax()))
    remain = tuple(one for one in ranked if one.surprise < best.surprise + ALIKE)
    blind = tuple(one for one in ranked[1:] if one not in remain and _is_blind(one, best))
    return Verdict(board, readings, _without_measured_twins(remain), blind, dead)


def judged_by_name(name: str, boards: Mapping[str, Board], readings: Readings, hand: Hand) -> Verdict:
    """The verdict about the board `name`, or which other of the published boards explains the readings better.

    boards: the layout of each name. A board whose chips are soldered cannot have exchanged channels. So the layout of
    another name is preferred to every fault that explains the readings no better. Raises TooLittleError.
    """
    verdict = judged(boards[name], readings, hand)
    drawn = {}
    for each, board in boards.items():
        search = _search(board, readings, hand, verdict.dead)
        found = search.as_drawn()
        if _is_explained(search, found):
            drawn[each] = found
    ranked = sorted(drawn, key=lambda each: drawn[each].surprise)
    if not ranked or (verdict.found and verdict.found[0].surprise < drawn[ranked[0]].surprise - SAME_READINGS):
        return verdict
    first = drawn[ranked[0]]
    alike = tuple(each for each in ranked if drawn[each].surprise < first.surprise + ALIKE)
    if alike == (name,):
        return verdict
    return Verdict(boards[alike[0]], readings, (first,), (), verdict.dead, layouts=alike)


def _search(board: Board, readings: Readings, hand: Hand, dead: NDArray[np.bool_]) -> Search:
    used = dead.sum(axis=1) < 2
    change = np.where(dead & used[:, None], np.nan, readings.change_t)
    return Search(board, Readings(change, readings.noise_t), hand, used)


def _is_explained(search: Search, found: Found) -> bool:
    """Whether the readings are as near to the fit as their errors allow."""
    change, used = search.fitter.readings.change_t, found.explanation.used[0]
    words = 2 + 1 + 3 * (len(change) - 1) + 3 * len(change) + (len(change) - 1)
    freedom = int(np.isfinite(change[:, used]).sum()) + words - 6 * len(change)
    return bool(found.fit.chi2[0] - found.fit.by_channel[0][~used].sum() <= quantile(FALSE_REFUSAL, freedom))


def _is_blind(one: Found, best: Found) -> bool:
    """Whether the readings do not exclude this fault. For an unobservable fault its prior probability decides."""
    less = float(one.fit.surprise[0] - best.fit.surprise[0])
    vague = (one.explanation.free & ~best.explanation.free).any() or (
        one.explanation.used != best.explanation.used
    ).any()
    return SAME_READINGS < less < EXCLUDED and not vague and one.description.image.is_same


def _without_measured_twins(remain: tuple[Found, ...]) -> tuple[Found, ...]:
    """A scale that is measured says no more than the same scale by its name."""
    kept: list[Found] = []
    for one in remain:
        if not any(_is_twin(one, other) for other in kept):
            kept.append(one)
    return tuple(kept)


def _is_twin(one: Found, other: Found) -> bool:
    mine, others = one.explanation, other.explanation
    is_alike = all((getattr(mine, name) == getattr(others, name)).all() for name in ("place", "turn", "used"))
    differ = (mine.free != others.free) | (mine.scale != others.scale)
    apart = np.abs(one.fit.magnets.log_scale - other.fit.magnets.log_scale)
    return bool(is_alike and differ.sum() == 1 and (mine.free | others.free)[differ].any() and apart.max() < SAME_SCALE)


def dead_axes(readings: Readings) -> NDArray[np.bool_]:
    """(N, 3) axes that read no change although most sensors measure the magnet well."""
    size = np.abs(readings.change_t)
    limit = DETECTED * np.sqrt(readings.noise_t**2 + AMBIENT_T**2) / 2.0
    silent: NDArray[np.bool_] = np.asarray(~(size > limit).any(axis=0), dtype=np.bool_)
    strength = np.nan_to_num(np.sqrt((readings.change_t**2).sum(axis=2))).max(axis=0)
    is_detected = float(np.median(strength)) > max(LEAST_FIELD_T, 4.0 * float(np.nanmax(limit)))
    return silent & is_detected
