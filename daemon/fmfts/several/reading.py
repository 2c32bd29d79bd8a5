"""The result of a frame of a pad with several magnets, and the memory for the next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.bus.messages import Health
from fmfts.contact.touch import TouchMemory
from fmfts.several.count import CounterMemory, Search
from fmfts.several.fit import Fit
from fmfts.several.free_poses import FreePoses
from fmfts.several.measured import Measured
from fmfts.several.recovery import RestMemory

Array = NDArray[np.float64]


class Seen(NamedTuple):
    """What is known of a frame before a closer look. has_jumped: as SinceRest.measured says. fit: of the fingers of the
    last frame, where C has made it."""

    measured: Measured
    has_jumped: bool
    fit: Fit | None = None


@dataclass(slots=True, kw_only=True)
class FingersMemory(RestMemory):
    """The memory from frame to frame. more: for how many frames two fingers must still explain the field until a third
    one counts as gone."""

    counter: CounterMemory = field(default_factory=CounterMemory)
    more: int = 0

    @property
    def is_calm(self) -> bool:
        """Whether the last frames were explained by all sensors."""
        return not (self.unexplained or self.more or self.unsettled) and self.left_out < 0


class FingersReading(NamedTuple):
    """The result of a frame. used (N, 3): the axes that it was made from. fit: None without a trustworthy one.

    more: two fingers do not explain the frame. measured: what `fit` was made from. least_variance (1 + K, 3): of the
    place (mm²) and force (N²) of the resultant and of each finger, where that is more than `fit` says. search: the
    state of the search for fingers. free: poses that explain the frame if no fingers do.
    """

    health: Health
    reason: str
    used: NDArray[np.bool_]
    fit: Fit | None = None
    ids: tuple[int, ...] = ()
    more: bool = False
    over_range: bool = False
    measured: Measured | None = None
    least_variance: Array | None = None
    search: Search = "none"
    free: FreePoses | None = None

    @property
    def tells(self) -> bool:
        """Whether it has a finger, or one beyond the table."""
        return self.fit is not None and len(self.fit.fingers) > 0

    @property
    def is_unexplained(self) -> bool:
        """Whether no fingers explain the frame, though they were searched."""
        return self.search != "due" and (self.health == "disturbed" or self.free is not None)


@dataclass(slots=True, kw_only=True)
class PosesMemory(RestMemory):
    """The memory of a pad without a table of presses. change (5M,): of the poses since rest. now_t (3N,): by how much
    they change the field."""

    change: Array
    now_t: Array
    touch: TouchMemory = field(default_factory=TouchMemory)


class PosesReading(NamedTuple):
    """The result of a frame of a pad without a table of presses. used (N, 3): the axes that it was made from. poses:
    None without trustworthy ones. touched: None if unknown."""

    health: Health
    reason: str
    used: NDArray[np.bool_]
    poses: FreePoses | None = None
    touched: bool | None = None
    search: Search = "none"

    @property
    def tells(self) -> bool:
        """Whether it has poses."""
        return self.poses is not None

    @property
    def is_unexplained(self) -> bool:
        """As of FingersReading, of poses."""
        return self.search != "due" and self.health == "disturbed"
