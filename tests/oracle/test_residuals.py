"""χ² of the mean residual, by generalised least squares with matrices, in the frames of frozen worlds.

With V the covariance of the mean's errors and J the derivatives of what the axes read by the unknowns, the part of the
mean m that no unknown explains has χ² = min over x of (m − Jx)ᵀV⁻¹(m − Jx). V: noise, which a mean reduces; errors that
no mean reduces; and common errors of the axes: the moment, and the unknowns that a baseline leaves.
"""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pose.problem import Part
from golden.replayed import pipelines_of
from golden.world import load
from oracle.field import Array, OneMagnet, differences, reading, turned

MEMORY, JUDGED_EVERY = 55, 8  # docs/glossary.md: a quarter of a second, at 220 Hz
COLUMNS = 14  # position 3, tilt 2, log moment, ambient field 3, its gradient 5
STEPS = np.array([1e-6] * 3 + [1e-4] * 2 + [1e-4] + [1e-6] * 3 + [1e-3] * 5)
LOG = 5
SOUND = 1e-9  # so small that each judgement gives its χ² as a multiple of it


def worth(frames: float) -> float:
    """How many independent frames a mean is worth: one over the sum of the squares of their weights."""
    if frames < MEMORY:
        return frames
    weights = (1.0 - 1.0 / MEMORY) ** np.arange(100 * MEMORY) / MEMORY
    return float(1.0 / (weights @ weights))


class Judged:
    """The pipeline's state after a frame that it judged."""

    def __init__(self, pipeline: PadPipeline) -> None:
        self.parameters, self.memory = pipeline._parameters, pipeline.memory.fields
        assert pipeline.mounting is not None
        self.lasting = pipeline.mounting.field_errors()
        self.axes = 3 * self.parameters.integer("sensors")

    def slopes(self) -> Array:
        """(axes, 14) derivatives of what each axis reads."""
        state, axes = self.memory["state"], self.axes
        place = np.repeat(self.parameters["place_m"][:axes].reshape(-1, 3), 3, axis=0)
        direction = self.parameters["direction"][: 3 * axes].reshape(-1, 3)

        def read(step: Array) -> Array:
            magnet = OneMagnet(
                state[:3] + step[:3],
                turned(state[3:6], step[3:5]),
                float(state[6] + step[LOG]),
                self.parameters.number("strength_t_m3"),
                self.parameters.number("octupole_m2"),
            )
            return reading(place, direction, [magnet], state[7:10] + step[6:9], step[9:])

        return differences(read, np.zeros(COLUMNS), STEPS)

    def common(self, slopes: Array) -> Array:
        assert self.lasting is not None
        errors = self.lasting.at(self.memory["change"][:5], self.memory["change"][5:])
        moment = slopes[:, LOG] * np.sqrt(self.memory["covariance"].reshape(COLUMNS, COLUMNS)[LOG, LOG])
        return np.asarray(errors @ errors.T + np.outer(moment, moment))

    def chi2(self) -> float:
        slopes, part = self.slopes(), self.parameters["part"]
        frames, mean = self.memory["frames"][: self.axes], self.memory["mean_t"][: self.axes]
        noise = np.array([worth(count) for count in frames])
        own = self.parameters["noise_t"][: self.axes] ** 2 / noise + self.memory["lasting_t2"][: self.axes]
        judged = frames >= 2 * JUDGED_EVERY
        covariance = (np.diag(own) + self.common(slopes))[np.ix_(judged, judged)]
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        unknown = whiten @ slopes[np.ix_(judged, np.isin(part, (Part.FREE, Part.PRIOR)))]
        left = whiten @ mean[judged]
        return float(np.sum((left - unknown @ np.linalg.lstsq(unknown, left, rcond=None)[0]) ** 2))


@pytest.mark.parametrize("world", ["slightly-off", "imperfect", "eight-sensors"])
def test_chi2_of_the_mean_residual_is_least_squares(world: str) -> None:
    (pad,), compared = load(world)[0].pads, 0
    with pipelines_of(load(world)[0]) as pipelines:
        (pipeline,) = pipelines.values()
        assert isinstance(pipeline, PadPipeline)
        pipeline._parameters.put("sound_chi2", np.full(37, SOUND))
        pipeline._parameters.put("alarm_chi2", np.full(37, np.inf))
        for _, events in islice(pad.events(), 420):
            health = pipeline.answer(events[0]).message.health
            judged = Judged(pipeline)
            if judged.memory["since"] % JUDGED_EVERY == 0 and health == "ok" and judged.memory["lasting_misfit"] > 1.0:
                found = float(judged.memory["lasting_misfit"]) * SOUND
                assert found == pytest.approx(judged.chi2(), rel=1e-6)
                compared += 1
    assert compared > 30
