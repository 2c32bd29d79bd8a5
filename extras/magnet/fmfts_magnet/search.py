"""Finds the explanations of the readings that are most probable: which place, turn and scale each channel has.

From a magnet that is guessed, each channel is compared with every place, turn and scale; the best explanation is then
fitted, which gives a better magnet, and so on. Guesses are the heights that a hand may have, and fits of simple faults.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts_magnet.assignment import SCALES, assigned
from fmfts_magnet.cost import Description, described
from fmfts_magnet.magnet import Explanations, Fits, Fitter, Magnets, fields
from fmfts_magnet.readings import Array, Board, Hand, Readings
from fmfts_magnet.symmetry import TURNS, images, numbers_of

HEIGHTS_M = (0.012, 0.02, 0.032, 0.05, 0.08)
START_HEIGHTS_M = (0.015, 0.03, 0.06)
ALL_PERMUTATIONS = 4  # of so many channels
KEPT = 12
ROUGH_ROUNDS, REFINED = 1, 48  # rounds of the first fits, and how many of them are fitted to the end
AGAIN = 2
HOPELESS = 100.0  # exceeds the difference of any two prior probabilities
Key = tuple[object, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """One explanation with its fit. surprise: −2 ln of its probability after the readings, up to a constant."""

    description: Description
    fit: Fits
    explanation: Explanations
    surprise: float


class Search:
    def __init__(self, board: Board, readings: Readings, hand: Hand, used: NDArray[np.bool_]) -> None:
        self.board, self.hand, self.used = board, hand, used
        self.fitter = Fitter(board, readings, hand)
        self.images = images(board)
        self.known: dict[Key, Found] = {}
        self.least = np.inf
        self.count = len(board)

    def run(self) -> list[Found]:
        """All examined explanations, the most probable first."""
        parts = [self._guessed()]
        for height_m in START_HEIGHTS_M:
            simple = self._simple()
            parts.append((simple, self._start(simple, height_m)))
        self._try(Explanations.joined(*(each[0] for each in parts)), Magnets.joined(*(each[1] for each in parts)))
        for _ in range(AGAIN):
            before = self._best()
            self._try(*self._reassigned(before))
        self._try(*self._neighbours(self._best()[:2]))
        self._try(*self._imaged(self._best()[:2]))
        return self._best(len(self.known))

    def as_drawn(self) -> Found:
        """The drawing alone, fitted."""
        for height_m in START_HEIGHTS_M:
            drawn = self._explanation()
            self._try(drawn, self._start(drawn, height_m))
        return self._best()[0]

    def _best(self, count: int = KEPT) -> list[Found]:
        return sorted(self.known.values(), key=lambda one: one.surprise)[:count]

    def _try(self, explanations: Explanations, start: Magnets) -> None:
        if not len(explanations):
            return
        rough = self.fitter.fit(explanations, start, ROUGH_ROUNDS)
        likely = np.argsort(rough.surprise)[:REFINED]
        explanations, fits = explanations[likely], self.fitter.fit(explanations[likely], rough.magnets[likely])
        self.least = min(self.least, float(fits.surprise.min()))
        for number in np.flatnonzero(fits.surprise < self.least + HOPELESS):
            one, fit = explanations[number : number + 1], fits[number : number + 1]
            key = _key(one)
            before = self.known.get(key)
            if before is not None and before.fit.surprise[0] <= fit.surprise[0]:
                continue
            description = before.description if before is not None else described(self.board, self.images, one)
            self.known[key] = Found(description, fit, one, float(fit.surprise[0]) + description.cost)

    def _explanation(
        self, place: Iterable[int] | None = None, turn: Array | None = None, used: NDArray[np.bool_] | None = None
    ) -> Explanations:
        count = self.count
        places = np.arange(count) if place is None else np.array(list(place))
        turns = np.broadcast_to(np.eye(3) if turn is None else turn, (count, 3, 3))
        ones = np.ones((1, count))
        is_used = self.used if used is None else self.used & used
        return Explanations(places[None], turns[None].copy(), ones, np.zeros((1, count), dtype=bool), is_used[None])

    def _simple(self) -> Explanations:
        """The drawing, channels exchanged, all chips turned or mirrored alike, and each channel left out."""
        count = self.count
        parts = [self._explanation()]
        if count <= ALL_PERMUTATIONS:
            parts += [self._explanation(place) for place in permutations(range(count))][1:]
        else:
            for one, other in combinations(range(count), 2):
                place = list(range(count))
                place[one], place[other] = other, one
                parts.append(self._explanation(place))
        parts += [self._explanation(turn=turn) for turn in TURNS[1:]]
        if self.used.sum() > 3:
            parts += [self._explanation(used=np.arange(count) != channel) for channel in range(count)]
        return Explanations.joined(*parts)

    def _start(self, explanations: Explanations, height_m: float) -> Magnets:
        """Magnets at this height where the instructions put them, their moments by least squares."""
        count, steps = len(explanations), self.fitter.steps
        position = np.broadcast_to(self.hand.offset_m + np.array([0.0, 0.0, height_m]), (count, steps, 3)).copy()
        unit = Magnets(position, np.ones((count, steps, 3)), np.log(explanations.scale))
        _, _, by_moment = fields(self.board, unit)
        chips = self.fitter.chips(explanations, unit)
        each = self.fitter.picked(by_moment, explanations.place)
        design = np.einsum("hcij,hckjl->hkcil", chips, each) * explanations.used[:, None, :, None, None]
        design = design.reshape(count, steps, -1, 3)
        data = (self.fitter.change * explanations.used[:, None, :, None]).reshape(count, steps, -1)
        normal = design.transpose(0, 1, 3, 2) @ design
        scale = np.trace(normal, axis1=2, axis2=3)[..., None, None]
        moment = np.linalg.solve(normal + 1e-9 * scale * np.eye(3), (design * data[..., None]).sum(axis=2)[..., None])[
            ..., 0
        ]
        return Magnets(position, moment, unit.log_scale)

    def _guessed(self) -> tuple[Explanations, Magnets]:
        """The best explanation of each channel under magnets that a hand may hold, without the drawing."""
        poles = (self.hand.pole,) if self.hand.pole else (1, -1)
        steps = self.fitter.steps
        size = np.sqrt((self.fitter.change**2).sum(axis=2))[:, self.used]
        found = []
        for height_m in HEIGHTS_M:
            position = (self.hand.offset_m + np.array([0.0, 0.0, height_m]))[None]
            moment = np.broadcast_to([0.0, 0.0, 1.0], (1, steps, 3))
            field = fields(self.board, Magnets(position, moment, np.zeros((1, self.count))))[0][0]
            strength = float(np.median(np.median(size) / np.sqrt((field**2).sum(axis=2))))
            for pole in poles:
                magnets = Magnets(position, moment * strength * pole, np.zeros((1, self.count)))
                found.append(assigned(self.fitter, self.used, magnets))
        return Explanations.joined(*(each[0] for each in found)), Magnets.joined(*(each[1] for each in found))

    def _reassigned(self, before: list[Found]) -> tuple[Explanations, Magnets]:
        found = [assigned(self.fitter, self.used, each.fit.magnets) for each in before]
        return Explanations.joined(*(each[0] for each in found)), Magnets.joined(*(each[1] for each in found))

    def _neighbours(self, best: list[Found]) -> tuple[Explanations, Magnets]:
        """Explanations that differ from these in one channel, or in two that are exchanged."""
        parts, starts = [], []

        def add(found: Found, **changes: Any) -> None:
            one = found.explanation
            values = {name: changes.get(name, getattr(one, name)) for name in one.__slots__}
            parts.append(Explanations(**values))
            starts.append(found.fit.magnets)

        for found in best:
            one = found.explanation
            for channel in np.flatnonzero(one.used[0]):
                for number in range(len(TURNS)):
                    turn = one.turn.copy()
                    turn[0, channel] = TURNS[number]
                    add(found, turn=turn)
                for value, is_free in ((1.0, False), (0.5, False), (2.0, False), (1.0, True)):
                    scale, free = one.scale.copy(), one.free.copy()
                    scale[0, channel], free[0, channel] = value, is_free
                    add(found, scale=scale, free=free)
                if one.used.sum() > 3:
                    used = one.used.copy()
                    used[0, channel] = False
                    turn, scale, free = one.turn.copy(), one.scale.copy(), one.free.copy()
                    turn[0, channel], scale[0, channel], free[0, channel] = np.eye(3), 1.0, False
                    add(found, used=used, turn=turn, scale=scale, free=free)
            for first, second in combinations(np.flatnonzero(one.used[0]), 2):
                place = one.place.copy()
                place[0, [first, second]] = place[0, [second, first]]
                add(found, place=place)
        return Explanations.joined(*parts), Magnets.joined(*starts)

    def _imaged(self, best: list[Found]) -> tuple[Explanations, Magnets]:
        """The same readings with the whole pad turned or mirrored, with the magnet's pole the other way round, or with
        another magnet and other scales."""
        parts, starts = [], []
        for found in best:
            one, magnets = found.explanation, found.fit.magnets
            for factor in (0.5, 2.0):
                scale = np.where(one.used, one.scale * factor, 1.0)
                if not one.free.any() and np.isin(scale, SCALES).all() and (scale[one.used] == 1.0).any():
                    parts.append(replace(one, scale=scale))
                    starts.append(replace(magnets, moment=magnets.moment / factor))
            for image in self.images:
                for sense in (1.0, -1.0):
                    turns = image.of_turns(one.turn[0], one.place[0], self.board, sense)
                    if turns is None:
                        continue
                    turns[~one.used[0]] = np.eye(3)
                    parts.append(Explanations(image.to[one.place], turns[None], one.scale, one.free, one.used))
                    moment = sense * np.linalg.det(image.matrix) * magnets.moment @ image.matrix.T
                    starts.append(Magnets(magnets.position_m @ image.matrix.T, moment, magnets.log_scale))
        return Explanations.joined(*parts), Magnets.joined(*starts)


def _key(one: Explanations) -> Key:
    scale = np.where(one.free[0], np.nan, one.scale[0])
    turns = numbers_of(one.turn[0])
    return (*one.place[0].tolist(), *turns.tolist(), *map(str, scale.tolist()), *one.used[0].tolist())
