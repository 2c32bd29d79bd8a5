"""The first frames of a pad whose baseline is older than they are, as after a restart."""

from __future__ import annotations

import pytest

from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.drills import FINGERS, TURNING_DEG_PER_S, DrillSource, pad_config, record
from fmfts_lab.bench.tapped import pipeline_of


@pytest.mark.parametrize("finger", FINGERS)
@pytest.mark.parametrize("turned_deg", [60.0, 120.0, 180.0])
def test_pad_that_starts_on_a_robot_that_has_turned_is_ok_at_once(finger: str, turned_deg: float) -> None:
    """It had been `disturbed` for up to 2 s, and had seen a motor for 2 s more."""
    for seed in range(1, 5):
        config = pad_config("drifting", seed)
        pipeline = pipeline_of(config, load_contact_model(config))
        source = DrillSource(config, start_s=turned_deg / TURNING_DEG_PER_S)
        told = [pipeline.process(frame) for frame in record(source, FINGERS[finger], 0.5)]
        assert {one.health for one in told} == {"ok"}
        assert not any(one.contact for one in told) or finger == "pressed"
