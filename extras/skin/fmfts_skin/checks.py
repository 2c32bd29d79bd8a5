"""What is wrong with the configuration of a pad whose magnets are unknown, besides what is checked of every pad."""

from __future__ import annotations

from collections.abc import Iterator

from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.section import Problem


def skin_problems(pad: PadConfig) -> Iterator[Problem]:
    """What such a pad cannot do."""
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
