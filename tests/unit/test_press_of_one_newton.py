"""The deviations that a baseline promises for a press of 1 N are those that the daemon then publishes."""

from __future__ import annotations

import numpy as np
import pytest
from test_pipeline import config_of, frames_of, pipeline_of

from fmfts.pipeline.press_of_one_newton import press_of_one_newton
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import steady_finger


@pytest.mark.parametrize("scene", [{"ambient": "constant"}, {"ambient": "drifting"}])
def test_promised_deviations_are_those_published(scene: dict[str, str]) -> None:
    config = config_of(**scene)
    pipeline = pipeline_of(config, simulated_baseline(config))
    promised = press_of_one_newton(pipeline)
    messages = [pipeline.process(frame) for frame in frames_of(config, steady_finger(0.0, 0.0, 1.0), 1.0)][110:]
    place_sd_m = np.median([max(one.x_sd_m or 0.0, one.y_sd_m or 0.0) for one in messages])
    force_sd_n = np.median([one.force_sd_n or 0.0 for one in messages])
    assert promised["middle_1n_place_sd_m"] == pytest.approx(place_sd_m, rel=0.25)
    assert promised["middle_1n_force_sd_n"] == pytest.approx(force_sd_n, rel=0.25)


def test_no_accuracy_is_predicted_without_a_baseline() -> None:
    assert press_of_one_newton(pipeline_of(config_of(), None)) == {}
