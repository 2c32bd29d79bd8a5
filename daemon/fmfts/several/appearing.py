"""A finger that begins to press after a frame's instant, in the samples since then.

They are of different times, and the force rises meanwhile. So a finger is looked for whose force rises evenly from
nothing: the change of a sample that has seen the share s of this time counts as 1/s of that of the newest one, with 1/s
of the noise. In so short a time the moments do not change, so that they explain nothing of it: else a press in the
middle, which lowers all magnets alike, would look like colder ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import SingularError
from fmfts.pad import Array
from fmfts.several.count import FingerCounter
from fmfts.several.estimator import FingersEstimator
from fmfts.several.fit import Fit, Fitter, Measured

LEAST_SHARE = 0.1  # of the time, of a sample that is about as old as the frame's instant


class Appearing:
    """For one pad with its baseline."""

    def __init__(self, estimator: FingersEstimator) -> None:
        mounting, fitter = estimator.mounting, estimator.fitter
        steady = Fitter(fitter.model.in_scene(replace(estimator.scene, moment=0.0)), fitter.grid)
        self._estimator, self._counter = estimator, FingerCounter(steady, estimator.rate_hz)
        self._gain, self._noise_t = mounting.gain, mounting.noise_t / mounting.gain

    def found(self, measured: Measured, newer_t: Array, passed_us: Array) -> tuple[Measured, Fit] | None:
        """The change since rest where the newest sample is, and the finger in it; None where there is none.

        measured: of the frame, in which nothing pressed. newer_t (N, 3): what the samples have changed by since then.
        passed_us (N,): how much later they are.
        """
        share = np.maximum(passed_us / max(float(passed_us.max()), 1.0), LEAST_SHARE)[:, None]
        risen_t = (newer_t / (share * self._gain * self._estimator.since_rest.moment)).ravel()
        since = replace(measured, field_t=risen_t, variance_t2=square(self._noise_t / share).ravel())
        newest = replace(since, field_t=measured.field_t + risen_t)
        try:
            finger = self._counter.appears(since, np.zeros(3))
            return None if finger is None else (newest, self._estimator.refit(finger.fingers, newest))
        except SingularError:
            return None
