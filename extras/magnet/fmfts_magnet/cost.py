"""The prior improbability of an explanation, as −2 ln of its probability, and its shortest description.

The probabilities are guesses of the frequency of errors in building, wiring and configuration. They decide only between
explanations that the readings cannot tell apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import factorial, inf, log

import numpy as np
from numpy.typing import NDArray

from fmfts_magnet.magnet import Explanations
from fmfts_magnet.readings import Array, Board
from fmfts_magnet.symmetry import TURNS, Image, numbers_of

IDENTITY = np.eye(3)
MIRRORED_Z = np.diag([1.0, 1.0, -1.0])


def _cost(probability: float, alternatives: float = 1.0) -> float:
    return 2.0 * log(alternatives / probability)


def is_quarter_about_z(turn: Array) -> bool:
    return bool(turn[2, 2] == 1.0 and np.linalg.det(turn) > 0.0)


@cache
def _share_of_turn(turn: bytes, count: int) -> float:
    """The cost of one chip of `count` that alone is turned like this; `turn` holds the matrix's bytes."""
    matrix = np.frombuffer(turn).reshape(3, 3)
    if (matrix == IDENTITY).all():
        return 0.0
    if is_quarter_about_z(matrix):
        return _cost(0.05, 3 * count)
    proper = np.linalg.det(matrix) > 0.0
    return _cost(0.02, (20 if proper else 24) * count)


@dataclass(frozen=True, slots=True)
class Description:
    """An explanation in words' order: the whole pad is `image`; all chips are `common`; then each channel alone.

    place (N,): of each channel, in the image. turn (N, 3, 3), scale (N,), free (N,), used (N,): of each channel.
    """

    image: Image
    common: Array
    place: NDArray[np.intp]
    turn: Array
    scale: Array
    free: NDArray[np.bool_]
    used: NDArray[np.bool_]

    @property
    def is_as_drawn(self) -> bool:
        return self.cost == 0.0

    @property
    def cost(self) -> float:
        count = len(self.place)
        total = 0.0 if self.image.is_same else _cost(0.02, 7)
        if (self.common != IDENTITY).any():
            usual = is_quarter_about_z(self.common) or (self.common == MIRRORED_Z).all()
            total += _cost(0.02, 4) if usual else _cost(0.005, 43)
        moved = int((self.place != np.arange(count)).sum())
        if moved:
            total += _cost(0.05, count * (count - 1) / 2) if moved == 2 else _cost(0.02, factorial(count))
        for channel in range(count):
            if not self.used[channel]:
                total += _cost(0.02, count)
                continue
            total += _share_of_turn(self.turn[channel].tobytes(), count)
            if self.free[channel]:
                total += _cost(0.02, count)
            elif self.scale[channel] != 1.0:
                total += _cost(0.05, 2 * count)
        return total


def described(board: Board, all_images: list[Image], one: Explanations) -> Description:
    """The most probable description of one explanation."""
    place, turn, used = one.place[0], one.turn[0], one.used[0]
    found: Description | None = None
    least = inf
    for image in all_images:
        back = Image(image.matrix.T, np.argsort(image.to))
        turns = back.of_turns(turn, place, board, 1.0)
        if turns is None:
            continue
        for common in set(numbers_of(turns[used]).tolist()) | {0}:
            alone = turns @ TURNS[common].T
            alone[~used] = np.eye(3)
            each = Description(image, TURNS[common], back.to[place], alone, one.scale[0], one.free[0], used)
            if (cost := each.cost) < least:
                found, least = each, cost
    assert found is not None, "the identity is one of the images"
    return found
