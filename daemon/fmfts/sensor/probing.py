"""What a source says of itself and of one pad on it; the same facts whether the daemon is asked or the device."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from fmfts.sensor import Source

NOTHING_MISSING: Mapping[int, str] = MappingProxyType({})


def faults_of(source: Source, pad_index: int, missing: Mapping[int, str] = NOTHING_MISSING) -> list[str]:
    """A sentence for everything that is wrong with this pad, its sensors, or with the whole source, now.

    missing: what frames show of sensors that cannot be used (missing.py). What the source says of a sensor is better.
    """
    state = source.state
    sensors = {sensor: text for (pad, sensor), text in state.sensor_faults.items() if pad == pad_index}
    seen = {sensor: f"sensor {sensor + 1} is {what}" for sensor, what in missing.items()}
    # What the pad is said to be, one of its sensors may be said to be, too.
    pads = [
        text
        for pad, text in state.pad_faults.items()
        if pad == pad_index and not any(text.endswith(of_sensor) for of_sensor in sensors.values())
    ]
    return pads + [text for _, text in sorted((seen | sensors).items())] + sorted(state.warnings.values())


def silence_of(source: Source, pad_index: int, patience_s: float) -> str:
    """Why no frame came within `patience_s`: what is wrong with the source, the pad or its sensors."""
    state = source.state
    if not state.connected or state.reason:
        return f"{state.description}: {state.reason}"
    known = faults_of(source, pad_index)
    return f"{state.description}: connected, but no frame within {patience_s:g} s" + (
        f": {'; '.join(known)}" if known else ""
    )


def is_sound(source: Source, pad_index: int, missing: Mapping[int, str] = NOTHING_MISSING) -> bool:
    """Nothing is known to be wrong with this pad or its sensors. Warnings about the whole source do not count."""
    state = source.state
    faulty = bool(missing) or any(pad == pad_index for pad, _ in state.sensor_faults)
    return not faulty and pad_index not in state.pad_faults


def probe_facts(
    pad: str, source: Source, pad_index: int, silence: str, missing: Mapping[int, str] = NOTHING_MISSING
) -> dict[str, Any]:
    """silence: what is known of frames that do not come, "" where they do. Who sends none is not connected, unless
    its sensors are known, and are why nothing of the pad is used.

    missing: as for `faults_of`. sound: the pad is connected, and all its sensors can be used.
    """
    state = source.state
    if pad_index in state.pad_faults and any(pad == pad_index for pad, _ in state.sensor_faults):
        silence = ""
    connected = state.connected and not silence
    return {
        "pad": pad,
        "source": state.description,
        "connected": connected,
        "sound": connected and is_sound(source, pad_index, missing),
        "reason": state.reason or silence,
        "board": dict(state.board),  # the source goes on changing its own
        "faults": faults_of(source, pad_index, missing),
    }
