"""What is compared: models of what a frame holds, what each costs, and what surrounds a pad."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.config import PadConfig
from fmfts.contact.response import Response
from fmfts.pose import FREE_FIELD, FREE_PAPER, FREE_POSE
from fmfts.scene.tracking import HOTTER_K, MOMENT_DEVIATION, MOMENT_WALK_PER_S, UNSEEN_WARMING_K
from fmfts.sensor.chips import CHIPS, NOISE_T

UNKNOWNS = {5: FREE_POSE, 6: FREE_PAPER, 8: FREE_FIELD, 9: np.arange(9)}
# What a running pad tracks with. To hold the moment in a constant field serves until it has aged; to free it in a field
# that drifts leaves height, moment and field unknown together.
RUNNING = (6, 8)
# A baseline serves for a shift; the Earth's field turns by up to twice its half gauss.
BASELINE_AGE_S = 8 * 3600.0
AMBIENT_CHANGE_T = 5e-5


@dataclass(frozen=True, slots=True)
class Model:
    """unknowns: 5 (pose), 6 (with the moment), 8 (with the ambient field), 9 (with both). cylinder: the field's next
    term after the dipole. neighbours: names of pads whose magnets are part of the state."""

    unknowns: int
    cylinder: bool
    neighbours: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int, bool]:
        return *self.unknown, self.cylinder

    @property
    def unknown(self) -> tuple[int, int]:
        return len(self.neighbours), self.unknowns

    def __str__(self) -> str:
        beside = f", with {' and '.join(self.neighbours)}" if self.neighbours else ""
        return f"{self.unknowns} unknowns, {'cylinder' if self.cylinder else 'dipole'}{beside}"


@dataclass(frozen=True, slots=True)
class Cost:
    """Rms over presses of place (mm) and force (N). In bounds, the noise that each press has where moment and field are
    known: bias_of: cause → what of the bias it makes; error: rms of noise and of every bias that some running model
    would do without."""

    model: Model
    noise_mm: float
    bias_mm: float
    noise_n: float
    bias_n: float
    error: float
    bias_of: dict[str, float]


@dataclass(frozen=True, slots=True)
class Surroundings:
    """noise_t: of one sample. others: the pads whose magnets could be felt, and the places of theirs."""

    config: PadConfig
    response: Response
    noise_t: float = NOISE_T
    others: Sequence[PadConfig] = ()

    @property
    def drifts(self) -> bool:
        """Does the ambient field change, so that no running model can tell the moment?"""
        return self.config.scene.ambient == "drifting" or self.config.scene.steel_nearby

    @property
    def moment_deviation(self) -> float:
        """Of a moment that is held, when the baseline is as old as it may be."""
        magnet, variance = self.config.magnet, MOMENT_DEVIATION**2 + MOMENT_WALK_PER_S * BASELINE_AGE_S
        if CHIPS[self.config.source.chip].thermometer is None:
            variance += (magnet.temperature_coefficient_per_k * UNSEEN_WARMING_K) ** 2
        if self.config.scene.remanence == "drifting":
            variance += (magnet.temperature_coefficient_per_k * HOTTER_K) ** 2
        return float(np.sqrt(variance))
