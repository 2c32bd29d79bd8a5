"""Records the baselines of the pads in a model, as a person does who sets a robot up: bare, at rest, and turned."""

from __future__ import annotations

import mujoco
from fmfts.baseline import Baseline
from fmfts.baseline.request import DURATION_S, TURN_S, BaselineRequest
from fmfts.sources import origin_of

from fmfts_mujoco.scene import Scene


def baselines(scene: Scene, data: mujoco.MjData, *, turned: bool = False) -> dict[str, Baseline]:
    """Record baselines of all pads, as the robot stands in `data`. Contacts there do not count. turned: also while the
    robot turns, without which shear is not known well. BaselineError if one cannot be made.
    """
    before: dict[str, Baseline | None] = dict.fromkeys((pad.name for pad in scene.pads), None)
    for kind in ("bare", "rest", "turn")[: 2 + turned]:
        bare, turns = kind == "bare", kind == "turn"
        frames = scene.unloaded(data, TURN_S if turns else DURATION_S, bare=bare, turned=turns)
        for pad, own in zip(scene.pads, frames, strict=True):
            request = BaselineRequest(
                pad.pad(), pad.tolerance.si(), bare=bare, turn=turns, replaced=False, origin=origin_of(pad)
            )
            before[pad.name], _ = request.make(own, before[pad.name])
    return {name: baseline for name, baseline in before.items() if baseline is not None}
