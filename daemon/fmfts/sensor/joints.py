"""Joint positions of a hand, for the frames of a pad on it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Joints:
    """The newest positions, in the order in which the baseline names the joints, and the ones before.

    time_ns, before_ns: on the host's clock; None: none came.
    """

    time_ns: int | None = None
    position_rad: tuple[float, ...] = ()
    before_ns: int | None = None
    before_rad: tuple[float, ...] = ()


NO_JOINTS = Joints()
