"""A mounted pad with unknown magnets: its field at rest, from which its contact model computes changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline.recording import Recording
from fmfts.pad import Pad

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RestField:
    """rest_t, noise_t (N, 3): the field at rest, the ambient field among it, and the noise of one sample.

    temperature_c: of the recording, None if it is unknown.
    """

    rest_t: Array
    noise_t: Array
    temperature_c: float | None

    @classmethod
    def of(cls, rest: Recording) -> RestField:
        return cls(rest.mean_t, rest.noise_t, rest.temperature_c)

    def remanence_t(self, pad: Pad) -> None:
        """Nobody knows it."""

    def moved_since(self, pad: Pad, recording: Recording) -> None:
        """Not known: a change of the field may come from temperature."""
