"""Records the baselines of the pads in a model, as a person does who sets a robot up: bare, then at rest."""

from __future__ import annotations

import mujoco
from fmfts.baseline import Baseline
from fmfts.baseline.request import DURATION_S, BaselineRequest
from fmfts.sources import origin_of

from fmfts_mujoco.scene import Scene


def baselines(scene: Scene, data: mujoco.MjData) -> dict[str, Baseline]:
    """Of all pads, as the robot stands in `data`. Contacts there do not count. BaselineError if one cannot be made."""
    before: dict[str, Baseline | None] = dict.fromkeys((pad.name for pad in scene.pads), None)
    for bare in (True, False):
        frames = scene.unloaded(data, DURATION_S, bare=bare)
        for pad, own in zip(scene.pads, frames, strict=True):
            request = BaselineRequest(pad.pad(), pad.tolerance.si(), bare=bare, replaced=False, origin=origin_of(pad))
            before[pad.name], _ = request.make(own, before[pad.name])
    return {name: baseline for name, baseline in before.items() if baseline is not None}
