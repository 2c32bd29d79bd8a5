"""The baseline of a pad that is a recording: the one that is in it, and no other."""

from __future__ import annotations

import msgspec

from fmfts.baseline import Baseline, BaselineError
from fmfts.config import PadConfig, ReplaySource
from fmfts.sensor import Source


def recorded_baseline(source: Source, pad_index: int) -> Baseline | None:
    """None where the pad had none. BaselineError where it is not one of this version."""
    from fmfts.recording.source import Replayed

    assert isinstance(source, Replayed)
    state = source.states[pad_index]
    try:
        return None if state.baseline is None else msgspec.convert(state.baseline, Baseline)
    except msgspec.ValidationError as error:
        raise BaselineError(f"pad '{state.pad}': the baseline in {source.state.description}: {error}") from error


def require_device(pad: PadConfig) -> None:
    """BaselineError where there is none: what is stored for a pad of this name must not come from its past."""
    if isinstance(pad.source, ReplaySource):
        raise BaselineError(f"pad '{pad.name}' is a recording, and its baseline is in it: there is nothing to record")
