"""Bounds how many frames of a source are handled, so that a flood of them leaves time for the other pads."""

from __future__ import annotations

from collections.abc import Sequence

from fmfts.sensor import Frame, SourceState
from fmfts.sensor.patience import RECORDED, Patience

# Frames of one pad in one poll. For a recorded pad: more than the backlog of a stall. Otherwise: as many as take 5 ms.
MOST_RECORDED, MOST_JUDGED = 256, 32
# The largest mean rate, as a multiple of the nominal one: above an inaccurate clock, or a board at the next higher
# rate.
MOST_TIMES_NOMINAL = 2.0
FLOOD = (
    f"more than {MOST_TIMES_NOMINAL:g} × rate_hz frames a second come, and those beyond it are left out: set rate_hz "
    "in [pad.source] to the rate of the device"
)


class Budget:
    """The frames of a source that may be handled. They grow with time, up to the backlog of a stall."""

    def __init__(self, rate_hz: float | None, pads: int) -> None:
        """rate_hz: nominal, of all pads together. None: it is not known, and only each poll is bounded."""
        self._pads = pads
        self._per_ns = None if rate_hz is None else MOST_TIMES_NOMINAL * rate_hz * 1e-9
        self._full = self._left = float(MOST_RECORDED * pads)
        self._at_ns: int | None = None

    def newest(
        self, frames: Sequence[Frame], now_ns: int, patience: Patience | None, state: SourceState
    ) -> Sequence[Frame]:
        """The newest frames of a poll, as many as may be handled now. The others are counted in `state`."""
        most = (MOST_RECORDED if patience in (None, RECORDED) else MOST_JUDGED) * self._pads
        if self._per_ns is not None:
            self._left = min(self._full, self._left + (now_ns - (self._at_ns or now_ns)) * self._per_ns)
            self._at_ns = now_ns
            if self._left < min(most, len(frames)):
                state.warnings["flood"] = FLOOD
            elif self._left == self._full:
                state.warnings.pop("flood", None)
            most = min(most, int(self._left))
            self._left -= min(most, len(frames))
        oldest = max(len(frames) - most, 0)
        for frame in frames[:oldest]:
            state.left_out[frame.pad_index] = state.left_out.get(frame.pad_index, 0) + 1
        return frames[oldest:]
