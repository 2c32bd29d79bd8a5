"""Checks of pads beside each other: neighbours that exist and lie apart, and sensors that two pads would read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

from fmfts.config import BridgeSource, I2cSource, PadConfig, PluggedSource
from fmfts.config.section import Key, Problem
from fmfts.config.several_checks import MAGNETS_APART_MM

MOST_NEIGHBOURS = 3
NEAR_MM = 100.0  # nearer magnets are felt: docs/scene.md
MOST_OTHER_MAGNETS = 8  # magnets of the neighbours of a pad with one magnet: the solver's state holds nine magnets


def of_neighbours(pads: Sequence[PadConfig]) -> Iterator[Problem]:
    names = [pad.name for pad in pads]
    for number, pad in enumerate(pads):
        for index, neighbour in enumerate(pad.scene.neighbours):
            keys = ("pad", number, "scene", "neighbours", index)
            if index >= MOST_NEIGHBOURS:
                yield keys, f"at most {MOST_NEIGHBOURS} neighbours: name the nearest"
            elif neighbour not in names:
                yield keys, f"there is no such pad: the pads are {', '.join(names)}"
            elif neighbour == pad.name:
                yield keys, "a pad is not its own neighbour"
            elif pads[names.index(neighbour)].model_kind is not None:
                yield keys, f"the magnets of {neighbour!r} are unknown, and so is their field here: keep it away"
            elif not pad.other_magnets and _magnets_of(pad, pads, index + 1) > MOST_OTHER_MAGNETS:
                yield (
                    keys,
                    f"with it, the neighbours have more than {MOST_OTHER_MAGNETS} magnets, which a pad with one magnet "
                    "cannot follow: name the nearest",
                )
            elif _magnets_apart_mm(pad, pads[names.index(neighbour)]) < MAGNETS_APART_MM:
                yield (
                    ("pad", number, "placement", "position_mm"),
                    f"its magnet is where that of its neighbour {neighbour!r} is: say in [pad.placement] of both where "
                    "they sit in a frame that they share; a pad that moves against this one cannot be a neighbour",
                )


def unnamed_neighbours(pad: PadConfig, pads: Sequence[PadConfig]) -> list[str]:
    """Warnings about pads whose magnets this one feels and whose poses it is not given.

    Pads at one place share no frame: nobody said where they are.
    """
    far_mm = {
        other.name: _magnets_apart_mm(pad, other)
        for other in pads
        if other.name not in (pad.name, *pad.scene.neighbours) and other.model_kind is None
    }
    return [
        f"pad {name!r} is {apart_mm:.0f} mm away, and its magnet is taken for a press or steel: "
        f"add it to scene.neighbours, or give placement.position_mm where it really is"
        for name, apart_mm in far_mm.items()
        if MAGNETS_APART_MM <= apart_mm < NEAR_MM and pad.model_kind is None
    ]


def _magnets_of(pad: PadConfig, pads: Sequence[PadConfig], count: int) -> int:
    """How many magnets the first `count` neighbours have."""
    named = pad.scene.neighbours[:count]
    return sum(len(other.other_magnets) + 1 for other in pads if other.name in named)


def _magnets_apart_mm(one: PadConfig, other: PadConfig) -> float:
    first, second = (
        [pad.placement.si().point(magnet.rest_position_m) * 1e3 for magnet in pad.pad().magnets] for pad in (one, other)
    )
    return min(math.dist(a, b) for a in first for b in second)


def _sensor_addresses(pad: PadConfig) -> set[tuple[Key, ...]]:
    """Addresses of the sensors that a source reads. Two pads must not share any: each would take the other's frames."""
    source = pad.source
    if isinstance(source, BridgeSource):
        return {(source.uid.lower() if source.uid else source.port, source.pad_index)}
    if isinstance(source, PluggedSource):
        return {(source.type, source.device)}
    if isinstance(source, I2cSource):
        addresses = source.sensor_addresses(len(pad.geometry.sensors_mm))
        if not source.channels:
            return {(source.bus, address) for address in addresses}
        return {(source.bus, *way) for way in zip(source.sensor_muxes, source.channels, addresses, strict=False)}
    return set()


_OWN_KEY: dict[type, str] = {BridgeSource: "pad_index", I2cSource: "channels"}


def of_shared_sensors(pads: Sequence[PadConfig]) -> Iterator[Problem]:
    for (first, one), (second, other) in combinations(enumerate(pads), 2):
        shared = _sensor_addresses(one) & _sensor_addresses(other)
        if shared:
            source = other.source
            what = source.key if isinstance(source, PluggedSource) else _OWN_KEY[type(source)]
            yield ("pad", second, "source", what), f"pad {pads[first].name!r} reads the same sensors"
