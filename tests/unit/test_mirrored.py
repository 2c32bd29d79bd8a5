"""Chips whose z is turned over against what is known of their kind: `[pad.geometry] sensors_mirrored`."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace as changed
from test_pipeline import config_of, pipeline_of

from fmfts.config import PadConfig
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import steady_finger
from fmfts_simulation.source import Simulated

FORCE_N, PLACE_M = 1.0, (2e-3, -1e-3)


@pytest.fixture
def config() -> PadConfig:
    config = config_of(3)
    return changed(config, geometry=changed(config.geometry, sensors_mirrored=True))


def test_mirrored_pad_detects_presses_like_any_other(config: PadConfig) -> None:
    pipeline = pipeline_of(config, simulated_baseline(config))
    source = Simulated(config)
    source.finger = steady_finger(*PLACE_M, FORCE_N)
    felt = [pipeline.process(frame) for step in range(220) for frame in source.poll(step * 4_545_454)][-1]
    assert felt.health == "ok"
    assert felt.force_n == pytest.approx(FORCE_N, abs=5 * felt.force_sd_n)
    assert np.hypot(felt.x_m - PLACE_M[0], felt.y_m - PLACE_M[1]) < 5 * np.hypot(felt.x_sd_m, felt.y_sd_m)
    assert felt.force_sd_n < 0.1 * FORCE_N


def test_only_z_is_inverted(config: PadConfig) -> None:
    field_t = np.tile([1e-5, 2e-5, 3e-5], (4, 1))
    sensors = config.pad().sensors
    assert sensors.to_sensor(field_t).tolist() == np.tile([1e-5, 2e-5, -3e-5], (4, 1)).tolist()
    assert sensors.to_pad(sensors.to_sensor(field_t)).tolist() == field_t.tolist()
