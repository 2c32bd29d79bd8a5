"""Chooses the smallest sufficient model, and finds the one that the configuration asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmfts.config import PadConfig
from fmfts.pose.problem import Part
from fmfts.pose.state import AMBIENT
from fmfts.scene.neighbours import neighbours_around
from fmfts.scene.tracking import tracking_model_for
from fmfts_lab.scene.candidate import RUNNING, Cost, Model, Surroundings

# Share by which a larger model must lower the error to be worth its unknowns, and the share for the cylinder's term,
# which adds no unknown.
WORTH, WORTH_OF_TERM = 0.1, 0.01


def recommended(candidates: Sequence[Cost]) -> Cost:
    """The running model with the fewest unknowns whose error is at most WORTH above the smallest.

    It has the cylinder's term where that lowers the error by WORTH_OF_TERM.
    """
    running = sorted((cost for cost in candidates if cost.model.unknowns in RUNNING), key=lambda cost: cost.model.size)
    sufficient = _first_within(WORTH, running)
    return _first_within(WORTH_OF_TERM, [cost for cost in running if cost.model.unknown == sufficient.model.unknown])


def _first_within(share: float, candidates: Sequence[Cost]) -> Cost:
    least = min(cost.error for cost in candidates)
    return next(cost for cost in candidates if cost.error <= (1.0 + share) * least)


def configured(surroundings: Surroundings) -> Model:
    """The model that the daemon runs with this config."""
    scene, pad = tracking_model_for(surroundings.config.scene, surroundings.config.magnet), surroundings.config.pad()
    neighbours = neighbours_around(surroundings.config, surroundings.others)
    felt = {neighbour.name for neighbour in neighbours if neighbour.is_felt}
    names = tuple(other.name for other in surroundings.others if other.name in felt)
    return Model(8 if scene.tracking.parts[AMBIENT.start] == Part.PRIOR else 6, pad.magnet.as_cylinder, names)


def placed_beside(config: PadConfig, pads: Sequence[PadConfig]) -> list[PadConfig]:
    """The pads with a known place relative to `config`'s pad, neighbours or not, the nearest first."""
    here = config.placement
    placed = [
        other
        for other in pads
        if other.name != config.name
        and (other.name in config.scene.neighbours or other.placement.position_mm != here.position_mm)
    ]
    return sorted(placed, key=lambda other: float(np.linalg.norm(other.placement.si().seen_from(here.si()).position_m)))
