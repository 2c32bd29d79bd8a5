"""What one frame says, before it is a message; and the sentences for a frame that says less than it might."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.bus.messages import Health
from fmfts.contact import ContactEstimate, NoContactModel
from fmfts.contact.now import ContactNow
from fmfts.pose import PoseEstimate
from fmfts.pose.track import Track

JUMPED = (
    "the field jumped between two samples by more than a finger can change it: a wire that was moved, a blow, "
    "a magnet, or frames that this computer left out"
)


@dataclass(frozen=True, slots=True)
class Reading:
    """What one frame says. used (N, 3): the axes that it was solved from. None: no trustworthy value.

    touching: in contact. force_sd_n: the deviation of the force to publish, which is 0 without contact.
    distance_m: how far the magnet is from rest, and the deviation of that; of a pad without a contact model only.
    now: the contact at the time of publishing. is_steady: health and reason stay while the same axes are missing.
    """

    health: Health
    reason: str
    used: NDArray[np.bool_]
    estimate: PoseEstimate | None = None
    contact: ContactEstimate | None = None
    touching: bool | None = None
    force_sd_n: float = 0.0
    distance_m: tuple[float, float] | None = None
    now: ContactNow | None = None
    is_steady: bool = False


def held(track: Track, unread_s: float) -> Track:
    return degraded(
        track,
        f"no temperature that the chips can have for {unread_s:.0f} s: the last good one is held (thermometer, wiring)",
    )


def degraded(track: Track, told: str) -> Track:
    reason = f"{track.reason}; {told}" if track.reason else told
    return replace(track, health="degraded", reason=reason, is_steady=False)


def without_model(
    model: NoContactModel, track: Track, touching: bool | None, distance_m: tuple[float, float]
) -> Reading:
    """Touch, pose and displacement; no place, no force. Whether a press can lift this pad's magnet is not known."""
    reason = f"{track.reason}; {model.reason}" if track.reason else model.reason
    parts = track.health, reason, track.used, track.estimate
    return Reading(*parts, touching=touching, distance_m=distance_m, is_steady=track.is_steady)
