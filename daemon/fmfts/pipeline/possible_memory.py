"""Checks the numbers of a pad's memory: C uses its indices and times unchecked, and a recording may contain any
number."""

from __future__ import annotations

import numpy as np

from fmfts.common.possible import Range
from fmfts.common.record import Values
from fmfts.pipeline import _pad

# Sums of two of them, in ns, fit into 64 bits. A board counts 48 bits.
MICROSECONDS = Range(-(2.0**50), 2.0**50, "time of a board in µs")
WHOLE = Range(-(2.0**61), 2.0**61, "time in ns, or count")
LOOKS = Range(0, 2**12 - 1, "frames that ambient_motion.c looked at")
CAUSES = Range(0, 5, "cause that fault_search.c finds")
NATIVE = Range(0, _pad.TRUSTED_FRAMES, "number of frames that tracker.c counts")
BLAMED = Range(0, 40, "frames until alternating.c forgets a blamed sensor")  # else it stays blamed for ever


def require_possible(fields: Values, sensors: int) -> None:
    """ValueError names the first number that is impossible for a pad with this many sensors."""
    mask = Range(0, 2**sensors - 1, f"set of {sensors} sensors")
    of_name = {
        "found_sensor": Range(-1, sensors - 1, f"sensor of {sensors}"),
        **dict.fromkeys(("heard", "suspects", "searched_sensors"), mask),
        "explained": LOOKS,
        "searched": CAUSES,
        "blamed": BLAMED,
        "native_frames": NATIVE,
    }
    for name, values in fields.items():
        if values.dtype.kind == "i":
            usual = MICROSECONDS if name.endswith("_us") else WHOLE
            of_name.get(name, usual).require(np.ravel(values).tolist())
