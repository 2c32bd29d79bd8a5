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


def is_sound(source: Source, pad_index: int) -> bool:
    """Nothing is known to be wrong with this pad or its sensors. Warnings about the whole source do not count."""
    state = source.state
    return pad_index not in state.pad_faults and all(pad != pad_index for pad, _ in state.sensor_faults)


def probe_facts(pad: str, source: Source, pad_index: int, silence: str) -> dict[str, Any]:
    """silence: what is known of frames that do not come, "" where they do. Who sends none is not connected.

    sound: the pad is connected, and all its sensors can be used.
    """
    state = source.state
    connected = state.connected and not silence
    return {
        "pad": pad,
        "source": state.description,
        "connected": connected,
        "sound": connected and is_sound(source, pad_index),
        "reason": state.reason or silence,
        "board": state.board,
        "faults": faults_of(source, pad_index),
    }
