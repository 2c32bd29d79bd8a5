"""Defines what is compared: tracking models, the cost of each, and the surroundings of a pad."""

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
# Numbers of unknowns that a running pad may have. The others fail in time: 5, because a held moment ages; 9, because
# height, moment and field cannot be told apart.
RUNNING = (6, 8)
# A baseline is used for a shift. When the pad turns over, the Earth's field of half a gauss changes by twice that.
BASELINE_AGE_S = 8 * 3600.0
AMBIENT_CHANGE_T = 5e-5


@dataclass(frozen=True, slots=True)
class Model:
    """unknowns: 5 (pose), 6 (with the moment), 8 (with the ambient field), 9 (with both). cylinder: with the term of
    the field after the dipole. neighbours: names of pads whose magnets are part of the state."""

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
    """Errors of a model: rms over presses, of the place in mm and of the force in N.

    error, bias_of are relative to the noise with a known moment and field. error: rms of the noise and of every bias
    that some running model avoids. bias_of: cause → its part of the bias.
    """

    model: Model
    noise_mm: float
    bias_mm: float
    noise_n: float
    bias_n: float
    error: float
    bias_of: dict[str, float]


@dataclass(frozen=True, slots=True)
class Surroundings:
    """noise_t: of one sample. others: the pads whose magnets this pad may measure."""

    config: PadConfig
    response: Response
    noise_t: float = NOISE_T
    others: Sequence[PadConfig] = ()

    @property
    def drifts(self) -> bool:
        """Does the ambient field change, so that no running model can estimate the moment?"""
        return self.config.scene.ambient != "constant" or self.config.scene.steel_nearby

    @property
    def moment_deviation(self) -> float:
        """Standard deviation of a held moment (relative), when the baseline is BASELINE_AGE_S old."""
        magnet, variance = self.config.magnet, MOMENT_DEVIATION**2 + MOMENT_WALK_PER_S * BASELINE_AGE_S
        if CHIPS[self.config.source.chip].thermometer is None:
            variance += (magnet.temperature_coefficient_per_k * UNSEEN_WARMING_K) ** 2
        if self.config.scene.remanence == "drifting":
            variance += (magnet.temperature_coefficient_per_k * HOTTER_K) ** 2
        return float(np.sqrt(variance))
