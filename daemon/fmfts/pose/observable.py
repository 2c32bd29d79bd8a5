"""Whether the sensors of a pad give enough values to tell the poses of all its magnets without a table of presses."""

from __future__ import annotations

from fmfts.pose.magnets import CHANGE

FREE_FIELD = 3  # values that the ambient field takes
# So many values more than are taken tell whether the poses explain a frame; and so many at least a pad has to have, so
# that it may lose a sensor. Where one value was left, poses that explained a frame were wrong beside a foreign magnet,
# which they bent to explain (lab/results/several.md).
FEWEST_SPARE, OBSERVABLE_SPARE = 3, 6


def taken_values(magnets: int) -> int:
    """How many values the poses of so many magnets and the ambient field take."""
    return FREE_FIELD + CHANGE * magnets


def needed_values(magnets: int) -> int:
    """How many values the sensors of a pad have to give."""
    return taken_values(magnets) + OBSERVABLE_SPARE


def needed_sensors(magnets: int) -> int:
    """The same in three-axis sensors."""
    return -(-needed_values(magnets) // 3)


def are_observable(magnets: int, sensors: int) -> bool:
    """Whether so many sensors tell the poses of so many magnets, and notice what is wrong with one of them."""
    return sensors >= needed_sensors(magnets)
