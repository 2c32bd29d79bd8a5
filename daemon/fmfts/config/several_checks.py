"""Errors in the configuration of a pad with several magnets, besides those of every pad."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.section import Problem
from fmfts.contact.no_model import NO_MODEL
from fmfts.pose.observable import are_observable, needed_sensors

FEWEST_SENSORS = 5
MAGNETS_APART_MM = 5.0  # nearer ones would overlap
# Keys that a pad with one magnet has, and this one would leave unread: by section and name, what to do instead.
UNREAD = {
    ("contact", "refine"): "fingers are already the most likely ones: leave it out",
    ("contact", "smoothing_ms"): "a pad with several magnets smooths nothing: leave it out, and smooth in your program",
    ("contact", "probe_mm"): "a pad with several magnets allows for fingers of 4 to 8 mm, always: leave it out",
    ("contact", "finger_mm"): "a pad with several magnets allows for fingers of 4 to 8 mm, always: leave it out",
}


def several_problems(pad: PadConfig) -> Iterator[Problem]:
    """Functions that a pad with several magnets lacks, and those that only such a pad has."""
    source, places = pad.source, [one.rest_mm for one in (pad.magnet, *pad.other_magnets)]
    if not pad.other_magnets:
        if isinstance(source, SimulatedSource) and source.fingers == 2:
            yield (
                ("source", "fingers"),
                "one magnet cannot distinguish two fingers: use the pad of docs/several.md",
            )
        return
    if pad.contact.model != NO_MODEL and len(pad.geometry.sensors_mm) < FEWEST_SENSORS:
        yield ("geometry", "sensors_mm"), f"two fingers need {FEWEST_SENSORS} sensors at least, and six if one may fail"
    for second, place in enumerate(places[1:]):
        if min(math.dist(place, other) for other in places[: second + 1]) < MAGNETS_APART_MM:
            yield ("other_magnets", second, "rest_mm"), f"another magnet is within {MAGNETS_APART_MM:g} mm of it"
    if pad.contact.model == "shear":
        yield ("contact", "model"), 'a pad with several magnets needs "default", or the file of a model made for it'
    sensors = len(pad.geometry.sensors_mm)
    if pad.contact.model == NO_MODEL and not are_observable(len(places), sensors):
        yield (
            ("contact", "model"),
            f"without a model {len(places)} magnets need {needed_sensors(len(places))} sensors at least, not "
            f'{sensors}: take more sensors, "default", or the file of a model made for it',
        )
    if source.publish == "sample" and pad.contact.model == NO_MODEL:
        yield ("source", "publish"), 'a pad without a table of presses has no `now`: set publish = "frame"'
    if isinstance(source, SimulatedSource) and (source.imperfections or source.finger_shape != "round"):
        yield ("source", "imperfections"), "they are simulated with one magnet only: leave them, and finger_shape, out"
    if pad.rebaseline.enabled:
        yield ("rebaseline", "enabled"), "the baseline of a pad with several magnets follows no drift: set it to false"
    yield from unread_keys(pad, UNREAD)


def unread_keys(pad: PadConfig, unread: Mapping[tuple[str, str], str]) -> Iterator[Problem]:
    """Keys with another value than the default that would have no effect. unread: what to do, by their names."""
    for (section, key), text in unread.items():
        own = getattr(pad, section)
        if getattr(own, key) != getattr(type(own)(), key):
            yield (section, key), text
