"""What a source says of itself and of one pad on it; the same facts whether the daemon is asked or the device."""

from __future__ import annotations

from typing import Any

from fmfts.sensor import Source


def faults_of(source: Source, pad_index: int) -> list[str]:
    """A sentence for everything that is wrong with this pad, its sensors, or with the whole source, now."""
    state = source.state
    sensors = [text for (pad, _), text in sorted(state.sensor_faults.items()) if pad == pad_index]
    pads = [text for pad, text in state.pad_faults.items() if pad == pad_index]
    return pads + sensors + sorted(state.warnings.values())


def probe_facts(pad: str, source: Source, pad_index: int, silence: str) -> dict[str, Any]:
    """silence: what is known of frames that do not come, "" where they do. Who sends none is not connected."""
    state = source.state
    return {
        "pad": pad,
        "source": state.description,
        "connected": state.connected and not silence,
        "reason": state.reason or silence,
        "board": state.board,
        "faults": faults_of(source, pad_index),
    }
