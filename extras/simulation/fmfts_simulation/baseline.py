"""Records the baseline of a simulated pad, bare and at rest, faster than real time, before anything touches it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from fmfts.baseline import Baseline
from fmfts.baseline.request import DURATION_S, BaselineRequest
from fmfts.config import PadConfig
from fmfts.sensor.frame import Frame
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.finger import no_finger
from fmfts_simulation.neighbour import NeighbourMagnets
from fmfts_simulation.source import Simulated


def simulated_baseline(config: PadConfig, beside: Sequence[PadConfig] = ()) -> Baseline:
    """The baseline of the pad that `config` simulates; the same seed builds the same pad. beside: pads whose magnets it
    measures."""
    return _recorded(config, tuple(beside))


@lru_cache(maxsize=64)  # studies and tests put many pipelines on one pad, and a recording takes 0.2 s of a processor
def _recorded(config: PadConfig, beside: tuple[PadConfig, ...]) -> Baseline:
    bare = BaselineRequest(config.pad(), config.tolerance.si(), bare=True, replaced=False)
    rest = BaselineRequest(config.pad(), config.tolerance.si(), bare=False, replaced=False)
    before, _ = bare.make(_frames(config, beside, mounted=False), None)
    return rest.make(_frames(config, beside, mounted=True), before)[0]


def hold_still(source: Simulated, mounted: bool) -> None:
    """Stop everything, as a person does for a baseline: nothing touches any pad, and the robot stands still."""
    for pad in pressed_pads(source):
        pad.finger, pad.second_finger = no_finger, None
    source.turning_rad_per_s = 0.0
    source.mounted = mounted


def pressed_pads(source: Simulated) -> list[Simulated | NeighbourMagnets]:
    """All pads that fingers may press: this one, and its neighbours."""
    return [source, *source.neighbours]


def _frames(config: PadConfig, beside: Sequence[PadConfig], mounted: bool) -> list[Frame]:
    source = simulated_pad(config, beside)
    hold_still(source, mounted)
    period_ns = round(1e9 / config.source.rate_hz)
    frames: list[Frame] = []
    for step in range(round(DURATION_S * config.source.rate_hz)):
        frames.extend(source.poll(step * period_ns))
    return frames
