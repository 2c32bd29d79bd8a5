"""Reads the baseline of a pad whose source is a recording: the one in the recording."""

from __future__ import annotations

import msgspec

from fmfts.baseline import Baseline, BaselineError
from fmfts.common.reading import damage_told
from fmfts.config import PadConfig, ReplaySource
from fmfts.sensor import Source


def recorded_baseline(source: Source, pad_index: int) -> Baseline | None:
    """The recorded baseline; None where the pad had none. Raises BaselineError where it is of another version."""
    from fmfts.recording.source import Replayed

    assert isinstance(source, Replayed)
    state = source.states[pad_index]
    if state.baseline is None:
        return None
    with damage_told(BaselineError, f"pad '{state.pad}': the baseline in {source.state.description} is damaged"):
        return msgspec.convert(state.baseline, Baseline)


def require_device(pad: PadConfig) -> None:
    """Raise BaselineError where the pad is a recording: a baseline made of old frames must not be stored for it."""
    if isinstance(pad.source, ReplaySource):
        raise BaselineError(f"pad '{pad.name}' is a recording, and its baseline is in it: there is nothing to record")
