"""A pad's memory before its first frame."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.common.record import Numbers, Values
from fmfts.pad import Pad
from fmfts.pipeline._pad import MEMORY, TRUSTED_FRAMES
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pose.state import AMBIENT, LOG_MOMENT

KEPT = ("number", "sampled_ns")  # of the last message: numbers go on
# The fields that alignment.c keeps of the last frames.
OF_SAMPLES = (
    *("field_t", "time_us", "repeats", "without_news", "newest_us", "leapt_us"),
    *("frame_us", "frame_ns", "sequence", "stood_ns", "stood_sequence"),
)

# Older recordings lack these, from before slip was detected.
OF_SLIP = (
    *("slip_frames", "slip_state", "slip_covariance", "slip_score", "slipping"),
    *("slip_since_s", "slip_speed", "slip_spread", "learnt_friction", "learnt_weight"),
    *("first_shear", "first_weight", "first_s"),
)

# And these, from before a mean residual told how far offsets drift, blamed sensors told of a motor, and the recent rest
# showed light presses; nor for how long the ambient field was the Earth's.
LATER = (
    *(*OF_SLIP, "further_drift", "calm_drift", "blamed"),
    *("recent_moved_s", "recent_change", "recent_ambient_t", "native_frames", "doubtful_frames"),
)

# A baseline may be of any age, as after a restart or a replaced cable. In a minute the ambient field walks by 57 µT, as
# much as if the robot had turned in the Earth's field by any angle.
UNSEEN_S = 60.0
# The fields that are not 0, and equal for every pad.
FIRST: dict[str, Numbers] = {
    "last_us": np.nan,
    "misfit": 1.0,
    "lasting_misfit": 1.0,
    "sound": 1,
    "found_sensor": -1,
    "lowest_t": np.full(3, np.inf),
    "highest_t": np.full(3, -np.inf),
    "modes": np.full(2, 0.5),
    "early_widths": np.ones(2),
}


def first_memory(pad: Pad, baselined: BaselinedPad | None) -> dict[str, Numbers]:
    """Every field of FMFTS_MEMORY (frame.h) but those that a pad keeps. baselined: None without a baseline."""
    memory: dict[str, Numbers] = {
        name: np.zeros(count) if count else 0.0 for name, _, count in MEMORY if name not in KEPT
    }
    memory |= FIRST | {"field_t": np.full(9 * len(pad.sensors), np.nan)}
    if baselined is None:
        return memory
    tracking = baselined.tracking
    variance, unread_variance = tracking.initial.copy(), square(tracking.moment_per_k * tracking.unread_warming_k)
    variance[AMBIENT] += UNSEEN_S * tracking.walk_per_s[AMBIENT]
    variance[LOG_MOMENT] += unread_variance
    return memory | {
        "state": baselined.mounting.rest.vector(),
        "covariance": np.diag(variance),
        "unread_variance": unread_variance,
    }


def with_later(fields: Values) -> Values:
    """The same, if an older version wrote it. Filters of slip with fewer numbers than now begin anew."""
    first = {name: np.zeros(count or (), kind) for name, kind, count in MEMORY if name in LATER}
    first["native_frames"][...] = TRUSTED_FRAMES  # it has run for long
    whole = "slip_state" in fields and fields["slip_state"].shape == first["slip_state"].shape
    return first | {name: value for name, value in fields.items() if whole or name not in OF_SLIP}


def without_samples(memory: dict[str, Numbers]) -> dict[str, Numbers]:
    """The same, for a pad that gets another baseline: its samples continue."""
    return {name: value for name, value in memory.items() if name not in OF_SAMPLES}
