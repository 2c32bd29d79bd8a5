"""Decides in which unexplained frames fingers are searched, and how.

A search takes long, and steel beside the pad would cause one in each frame. So it is made in the first frames, and then
in each tenth. Two kinds alternate, so that no frame takes longer than 3 ms. Those with even numbers search for a second
finger, or a sensor without which the previous frame's fingers explain the field. Those with odd numbers search for any
fingers without one sensor, another one each time.
"""

from __future__ import annotations

SEARCHED_FRAMES, SEARCHED_EVERY = 20, 10


def is_searched(unexplained: int) -> bool:
    """After this many unexplained frames in a row."""
    return unexplained <= SEARCHED_FRAMES or unexplained % SEARCHED_EVERY == 0


def number_of(unexplained: int) -> int:
    """Number of searches in this many unexplained frames in a row."""
    return min(unexplained, SEARCHED_FRAMES - SEARCHED_FRAMES // SEARCHED_EVERY + unexplained // SEARCHED_EVERY)
