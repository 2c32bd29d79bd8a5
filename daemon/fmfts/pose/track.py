"""What a tracker says of one frame, and what it remembers of the frames before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.pose.residual_monitor import ResidualMonitorMemory, TrackHealth
from fmfts.pose.solver import PoseEstimate
from fmfts.pose.state import State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Track:
    """The verdict on one frame. estimate: None unless health is ok or degraded.

    used (N, 3): the axes that the estimate was solved from. reason: empty if ok. stronger: the frame fits a magnet that
    is stronger than at its baseline, which no magnet is. is_steady: the verdict stays while the same axes are missing.
    """

    estimate: PoseEstimate | None
    used: NDArray[np.bool_]
    health: TrackHealth
    reason: str
    stronger: bool = False
    is_steady: bool = False


@dataclass(slots=True)
class TrackerMemory:
    """state, covariance (SIZE, SIZE): of the last good frame, `since_good_s` seconds ago. misfit: recent mean of χ² per
    degree of freedom.

    unread_variance: what the unknown temperature adds to the variance of the log moment, until a temperature is read.
    warmth_variance: the most that warming has added to it. disturbed_frames: how many frames no pose explained since
    then. verdict: result of the last search for the cause.
    """

    state: State
    covariance: Array
    unread_variance: float
    watch: ResidualMonitorMemory | None
    since_good_s: float = 0.0
    warmth_variance: float = 0.0
    disturbed_frames: int = 0
    misfit: float = 1.0
    verdict: tuple[TrackHealth, str] = ("lost", "")
