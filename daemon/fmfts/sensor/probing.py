"""Facts of a source and of one of its pads; the same from the daemon and from the device."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from fmfts.sensor import Source
from fmfts.sensor.source import OPENING
from fmfts.sensor.tasks import OPENING_S, PATIENCE_S

AGAIN_S = 0.1
NOTHING_MISSING: Mapping[int, str] = MappingProxyType({})


def once_connected(probe: Callable[[], dict[str, Any] | None]) -> dict[str, Any] | None:
    """What a running daemon answers to `probe` once all its pads are connected, or if they are not for too long."""
    begun_s = time.monotonic()
    while True:
        facts = probe()
        pads = () if facts is None else facts["pads"]
        patience_s = OPENING_S if any(pad["reason"] == OPENING for pad in pads) else PATIENCE_S
        if all(pad["connected"] for pad in pads) or time.monotonic() - begun_s > patience_s:
            return facts
        time.sleep(AGAIN_S)


def faults_of(source: Source, pad_index: int, missing: Mapping[int, str] = NOTHING_MISSING) -> list[str]:
    """A sentence for everything that is wrong with this pad, its sensors, or with the whole source, now.

    missing: what frames show of sensors that cannot be used (missing.py). The source's own report about a sensor has
    priority.
    """
    state = source.state
    sensors = {sensor: text for (pad, sensor), text in state.sensor_faults.items() if pad == pad_index}
    seen = {sensor: f"sensor {sensor + 1} is {what}" for sensor, what in missing.items()}
    # Also reported of the pad, unless already of a sensor.
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
    """This pad and its sensors have no known fault. Warnings about the whole source do not count."""
    state = source.state
    faulty = bool(missing) or any(pad == pad_index for pad, _ in state.sensor_faults)
    return not faulty and pad_index not in state.pad_faults


def probe_facts(
    pad: str, source: Source, pad_index: int, silence: str, missing: Mapping[int, str] = NOTHING_MISSING
) -> dict[str, Any]:
    """silence: why no frames come, "" if they come. A source without frames is not connected, unless faults of its
    known sensors are the reason.

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
        "board": dict(state.board),  # a copy, because the source keeps changing its own
        "faults": faults_of(source, pad_index, missing),
    }
