"""Errors in the configuration of a pad with unknown magnets, besides the checks of every pad."""

from __future__ import annotations

from collections.abc import Iterator

from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.section import Problem
from fmfts.config.several_checks import unread_keys

# As UNREAD of fmfts.config.several_checks.
UNREAD = {
    ("contact", "refine"): "a table of fields has nothing to refine: leave it out",
    ("contact", "smoothing_ms"): "a pad whose magnets are unknown smooths nothing: leave it out",
    ("contact", "friction"): "how wrong a table of fields may be is in its file: leave it out",
    ("contact", "probe_mm"): "how wrong a table of fields may be is in its file: leave it out",
    ("contact", "finger_mm"): "how wrong a table of fields may be is in its file: leave it out",
    ("silicone", "creep_per_decade"): "how wrong a table of fields may be is in its file: leave it out",
    ("silicone", "hysteresis"): "how wrong a table of fields may be is in its file: leave it out",
    ("scene", "remanence"): "a pad whose magnets are unknown estimates no remanence: leave it out",
}


def skin_problems(pad: PadConfig) -> Iterator[Problem]:
    """Keys that such a pad cannot use."""
    if isinstance(pad.source, SimulatedSource):
        yield ("contact", "model"), "a table of fields is for a real skin: what is simulated has magnets that are known"
    if pad.scene.neighbours:
        yield (
            ("scene", "neighbours"),
            "a pad whose magnets are unknown does not model its neighbours: leave them out",
        )
    if pad.source.publish == "sample":
        yield ("source", "publish"), 'a pad whose magnets are unknown publishes frames only: set publish = "frame"'
    if pad.rebaseline.enabled:
        yield ("rebaseline", "enabled"), "the baseline of a pad whose magnets are unknown follows no drift: false"
    yield from unread_keys(pad, UNREAD)
