"""What every contact method gets: a world, its recorded baseline, and its contact model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from fmfts.baseline import Mounting
from fmfts.contact import ContactModel
from fmfts.contact.response import Response
from fmfts.pad import Array
from fmfts_lab.calibration.regressors import BackPropagation, RadialBasis
from fmfts_lab.study.learned import SEED
from fmfts_lab.study.world import Sample, World

TRAINING_STEPS = 60
# The lightest press of the paper. Under lighter presses places are uncertain by 2 mm and more.
LIGHTEST_N = 0.28


@dataclass(frozen=True, slots=True)
class Bench:
    """A world with its recorded baseline, and the contact model in the pad's config."""

    world: World
    mounting: Mounting
    model: ContactModel
    refining: ContactModel

    @classmethod
    def of(cls, world: World) -> Bench:
        """The bench of a world. ModelError if the config's model is not for this pad."""
        mounting = world.baseline(np.random.default_rng(SEED)).mounting(world.drawing)
        path = world.config.contact.model
        plain, refining = (ContactModel.load(path, world.drawing, refine=refine) for refine in (False, True))
        return cls(world, mounting, plain, refining)

    @property
    def mounted(self) -> World:
        """The world with the mounting that the baseline estimated."""
        pad = self.mounting.mounted(self.world.drawing)
        magnet = pad.magnet.with_remanence(self.mounting.remanence_t(self.world.drawing))
        return replace(self.world, drawing=replace(pad, magnet=magnet))

    @property
    def response(self) -> Response:
        assert self.refining.refiner is not None
        return self.refining.refiner.response

    def field(self, sample: Sample) -> Array:
        """(N, 3) the magnet's field, by the baseline."""
        return self.mounting.magnet_field(sample.frame.field_t)


class ContactFinder(Protocol):
    """Only `ask` is timed. `told` converts its result to a press (3,) in mm and N, None if there is none."""

    def ask(self, sample: Sample) -> Any: ...

    def told(self, raw: Any) -> Array | None: ...


def regressor_of(kind: str, size: tuple[int, ...]) -> BackPropagation | RadialBasis:
    return BackPropagation(size, TRAINING_STEPS) if kind == "BP" else RadialBasis(size[0], ridge=1e-6)
