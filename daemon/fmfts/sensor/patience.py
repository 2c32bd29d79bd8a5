"""How long frames wait for a late daemon before newer ones of the same pad supersede them."""

from __future__ import annotations

from typing import NamedTuple


class Patience(NamedTuple):
    """At most `most` frames of one pad stay, none older than the newest by more than `longest_us`."""

    most: int
    longest_us: int


# Three frames at 220 Hz: frames of an adapter's burst, or of a short delay of the scheduler, are used; a longer backlog
# is not.
IN_TIME = Patience(1 << 30, 15_000)
BEHIND = Patience(1, 15_000)
RECORDED = Patience(1 << 30, 200_000)  # a recorder wants all frames, also those that are not judged
