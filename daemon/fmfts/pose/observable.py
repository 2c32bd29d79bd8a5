"""Whether the sensors of a pad give enough values to tell the poses of all its magnets without a table of presses."""

from __future__ import annotations

from fmfts.pose.magnets import CHANGE

FREE_FIELD = 3  # values that the ambient field takes
# Redundant values that a check of the poses needs, and that a pad needs in total so that it may lose a sensor. With one
# redundant value, poses fitted a foreign magnet's field and were wrong (lab/results/several.md).
FEWEST_SPARE, OBSERVABLE_SPARE = 3, 6


def taken_values(magnets: int) -> int:
    """How many values the poses of so many magnets and the ambient field take."""
    return FREE_FIELD + CHANGE * magnets


def needed_values(magnets: int) -> int:
    """How many values the sensors of a pad have to give."""
    return taken_values(magnets) + OBSERVABLE_SPARE


def needed_sensors(magnets: int) -> int:
    """The needed number of three-axis sensors."""
    return -(-needed_values(magnets) // 3)


def are_observable(magnets: int, sensors: int) -> bool:
    """Whether this many sensors determine the poses of this many magnets, and detect a fault of one sensor."""
    return sensors >= needed_sensors(magnets)
