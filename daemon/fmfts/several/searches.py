"""In which of the frames that nothing explains fingers are searched, and how.

A search takes long, and steel that lies beside the pad would make it each frame. So it is made in the first frames,
and then in each tenth. It is one of two, by turns, so that no frame takes longer than 3 ms: those with even numbers are
for a second finger, and for a sensor without which the fingers of the frame before explain the field; those with odd
numbers are for any fingers without one sensor, another one each time.
"""

from __future__ import annotations

SEARCHED_FRAMES, SEARCHED_EVERY = 20, 10


def is_searched(unexplained: int) -> bool:
    """After so many frames in a row that nothing explains."""
    return unexplained <= SEARCHED_FRAMES or unexplained % SEARCHED_EVERY == 0


def number_of(unexplained: int) -> int:
    """How many searches were made in so many frames in a row that nothing explains."""
    return min(unexplained, SEARCHED_FRAMES - SEARCHED_FRAMES // SEARCHED_EVERY + unexplained // SEARCHED_EVERY)
