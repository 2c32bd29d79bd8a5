"""Which model is enough, which one the config asks for, and what to say where they differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmfts.baseline import Mounting
from fmfts.config import PadConfig
from fmfts.contact.response import Response
from fmfts.pose.problem import Part
from fmfts.pose.state import AMBIENT
from fmfts.scene.candidate import RUNNING, Cost, Model, Surroundings
from fmfts.scene.error_budget import costs, rms
from fmfts.scene.tracking import around as neighbours_around
from fmfts.scene.tracking import choose
from fmfts.sensor.chips import CHIPS

# A larger model has to lower the error by this share to be worth its unknowns; by this, to be worth a term without any.
WORTH, WORTH_OF_TERM = 0.1, 0.01


def recommended(found: Sequence[Cost]) -> Cost:
    """The fewest unknowns that a pad can run with, and whose error is no more than WORTH above the least; with the
    cylinder's term where it lowers that by WORTH_OF_TERM."""
    running = sorted((cost for cost in found if cost.model.unknowns in RUNNING), key=lambda cost: cost.model.size)
    enough = _first_within(WORTH, running)
    return _first_within(WORTH_OF_TERM, [cost for cost in running if cost.model.unknown == enough.model.unknown])


def _first_within(share: float, found: Sequence[Cost]) -> Cost:
    least = min(cost.error for cost in found)
    return next(cost for cost in found if cost.error <= (1.0 + share) * least)


def configured(around: Surroundings) -> Model:
    """What the daemon makes of the config."""
    scene, pad = choose(around.config.scene, around.config.magnet), around.config.pad()
    felt = {neighbour.name for neighbour in neighbours_around(around.config, around.others) if neighbour.is_felt}
    names = tuple(other.name for other in around.others if other.name in felt)
    return Model(8 if scene.tracking.parts[AMBIENT.start] == Part.PRIOR else 6, pad.magnet.as_cylinder, names)


def advice(
    config: PadConfig, pads: Sequence[PadConfig], response: Response | None, mounting: Mounting | None
) -> str | None:
    """A sentence for the log where the config has more or less than its scene needs; None too where no response of the
    pad tells. mounting: what a baseline recorded, whose noise it is then."""
    if response is None:
        return None
    noise_t = CHIPS[config.source.chip].noise_t if mounting is None else rms(mounting.noise_t)
    around = Surroundings(config, response, noise_t, placed_beside(config, pads))
    needed, has = recommended(costs(around, thorough=False)).model, configured(around)
    if needed.unknown == has.unknown:  # the cylinder's term is no key of the config: it is taken where it is felt
        return None
    how = "more" if has.unknown > needed.unknown else "less"
    return f"the config has {how} than its scene needs: {has}; recommended: {needed} (fmfts-daemon study scene)"


def placed_beside(config: PadConfig, pads: Sequence[PadConfig]) -> list[PadConfig]:
    """The pads whose place against `config`'s is known, whether it names them or not; the nearest first."""
    here = config.placement
    placed = [
        other
        for other in pads
        if other.name != config.name
        and (other.name in config.scene.neighbours or other.placement.position_mm != here.position_mm)
    ]
    return sorted(placed, key=lambda other: float(np.linalg.norm(other.placement.si().seen_from(here.si()).position_m)))
