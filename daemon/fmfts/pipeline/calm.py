"""A calm frame of several magnets, which the fingers of the last one explain: C judges all of it (_calm.c)."""

from __future__ import annotations

from math import prod

import numpy as np

from fmfts.pad import Array
from fmfts.pipeline.finger import SURE_DEVIATIONS
from fmfts.pipeline.several_frames import SeveralFrames
from fmfts.several.estimator import FingersEstimator
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Fit
from fmfts.several.measured import Measured
from fmfts.several.reading import FingersReading, Seen


class CalmFrames:
    """For one pad with its baseline. frames: of its C, which is bound here. followed: a record of FOLLOWED."""

    def __init__(self, estimator: FingersEstimator, frames: SeveralFrames, followed: memoryview) -> None:
        fitter, mounting = estimator.fitter, estimator.mounting
        self._estimator, self._compiled, self._found = estimator, frames.compiled, frames.found
        magnets, sure_t = mounting.magnets, SURE_DEVIATIONS * mounting.noise_t
        rest = magnets.position_m, magnets.axis, estimator.unfelt_variance, sure_t
        untouched = np.concatenate([np.ravel(each) for each in rest])
        limits, samples = estimator.calm_limits, estimator.since_rest.rest
        given = fitter.model.packed, fitter.search, fitter.model.work, limits, samples, untouched
        frames.bind(*given, followed)
        values = mounting.noise_t.size
        names = "change_t", "variance_t2", "used", "misfit_t", "noise_t"
        change, variance, used, self._misfit_t, self._noise_t = (self._found[name][:values] for name in names)
        self.measured = Measured(change, variance, used.view(np.bool_))
        self._ambient_t, self.has_now = self._found["ambient_t"], False

    def payload(self, temperature_c: float) -> bytes | Seen:
        """The message; or what is known of a frame that needs a closer look."""
        memory = self._estimator.memory
        counter, before = memory.counter, memory.ambient_t
        told = self._compiled.calm(
            counter.count,
            counter.places,
            counter.ids,
            before,
            memory.recovery.recent_t,
            self._estimator.since_rest.factors,
            temperature_c,
        )
        if len(told) == 2:
            payload, self.has_now = told
            self._estimator.goes_on(self._places(counter.count), self._ambient_t.copy())
            return payload
        has_jumped, has_fit, chi2, flags = told
        return Seen(self.measured, has_jumped, self._fit(chi2, flags) if has_fit else None)

    def _places(self, count: int) -> Array:
        return self._found["fingers"][: FINGER * count].reshape(count, FINGER)

    def _fit(self, chi2: float, flags: int) -> Fit:
        """Of the last frame, as long as there is no other one."""
        count, values = self._estimator.memory.counter.count, len(self._misfit_t)
        unknowns = FINGER * count

        def part(name: str, *shape: int) -> Array:
            return self._found[name][: prod(shape)].reshape(shape)

        return Fit(
            self._places(count),
            part("covariance", unknowns, unknowns),
            chi2,
            self._misfit_t,
            self._ambient_t,
            part("shear_n", count, 2),
            part("shear_deviation_n", count, 2),
            self._noise_t,
            part("slope_t", values, unknowns),
            flags,
            values,
        )

    @property
    def reading(self) -> FingersReading:
        """Of the last frame, which was calm."""
        used = self.measured.used.reshape(-1, 3)
        return FingersReading("ok", "", used, self._fit(0.0, 0), measured=self.measured)
