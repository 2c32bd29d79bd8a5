"""Signed permutations of three axes, and the turns and mirrors that map a pad's places onto themselves."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from fmfts_magnet.readings import Array, Board

SAME_PLACE_M = 1.5e-3
ROUNDED = 0.1  # largest difference of a matrix from a signed permutation


def _signed_permutations() -> Array:
    matrices = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrices.append(np.eye(3)[list(order)] * np.array(signs)[:, None])
    return np.array(sorted(matrices, key=lambda one: (-np.trace(one), -np.linalg.det(one))))


# The first is that of a chip as drawn. 24 are rotations, and 24 are mirrored.
TURNS = _signed_permutations()


def numbers_of(turns: Array) -> NDArray[np.intp]:
    """Which of TURNS each of these matrices (N, 3, 3) is, or is most like."""
    return np.asarray(np.einsum("sij,cij->cs", TURNS, turns).argmax(axis=1), dtype=np.intp)


@dataclass(frozen=True, slots=True)
class Image:
    """A whole pad, turned or mirrored. matrix (3, 3): from the drawing to its real place. to (N,): the place that each
    of the drawing's places comes to."""

    matrix: Array
    to: NDArray[np.intp]

    @property
    def is_same(self) -> bool:
        return bool((self.matrix == np.eye(3)).all())

    def of_turns(self, turns: Array, place: NDArray[np.intp], board: Board, sense: float) -> Array | None:
        """The turns (…, N, 3, 3) with which channels at the images have the same readings as at `place`, if there are
        any."""
        whole = sense * np.linalg.det(self.matrix)
        before, after = board.axes[place], board.axes[self.to[place]]
        found = whole * turns @ before.transpose(0, 2, 1) @ self.matrix.T @ after
        rounded = TURNS[numbers_of(found)]
        return rounded if np.abs(rounded - found).max() < ROUNDED else None


def images(board: Board) -> list[Image]:
    """The quarter turns about z and the mirrors of x, y and their diagonals that leave the set of places as it is."""
    found = []
    for matrix in TURNS:
        if matrix[2, 2] != 1.0:
            continue
        distance = np.linalg.norm((board.place_m @ matrix.T)[:, None] - board.place_m, axis=2)
        to = distance.argmin(axis=1)
        if distance.min(axis=1).max() < SAME_PLACE_M and len(set(to.tolist())) == len(to):
            found.append(Image(matrix, to))
    return found
