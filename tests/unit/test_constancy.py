"""A scene that calls the ambient field constant, on a robot that turns: one clear message, and no blamed sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmfts.bus.messages import ContactMessage
from fmfts.pipeline.configured import load_contact_model
from fmfts.sensor import Frame
from fmfts_lab.bench.drills import FRAME_NS, live_finger, pad_config
from fmfts_lab.bench.tapped import pipeline_of
from fmfts_simulation.source import Simulated


def published(turning_deg_per_s: float, seconds: float, offset_counts: int = 0) -> list[ContactMessage]:
    """A pressed pad whose scene is constant; after the first second it turns, or an axis of sensor 2 is wrong."""
    config = pad_config("constant", seed=1)
    pipeline = pipeline_of(config, load_contact_model(config))
    source, messages = Simulated(config), []
    source.finger, source.turning_rad_per_s = live_finger, float(np.deg2rad(turning_deg_per_s))
    for step in range(round(seconds * 220)):
        for frame in source.poll(step * FRAME_NS):
            messages.append(pipeline.process(shifted(frame, offset_counts if step > 220 else 0)))
    return messages


def shifted(frame: Frame, counts: int) -> Frame:
    changed = frame.counts.copy()
    changed[1, 0] += counts
    return replace(frame, counts=changed)


@pytest.mark.parametrize(("turning_deg_per_s", "within_s"), [(20.0, 1.0), (5.0, 2.0)])
def test_turning_pad_advises_drifting_ambient(turning_deg_per_s: float, within_s: float) -> None:
    """In that time the half gauss of the Earth moves by 170 mG, and at 5° a second by 87."""
    messages = published(turning_deg_per_s, within_s + 0.5)
    assert [message.health for message in messages].count("degraded") == 0, "no sensor is at fault"
    for message in messages[round(within_s * 220) :]:
        assert message.health == "disturbed"
        assert 'set ambient = "drifting"' in message.reason
        assert message.contact is None
    moved = [float(message.reason.split(" mG")[0].split()[-1]) for message in messages[round(within_s * 220) :]]
    assert moved == sorted(moved), "how far it has moved so far"
    assert moved[0] >= 5.0


def test_unmoved_pad_is_not_reported_as_moved() -> None:
    assert {message.health for message in published(0.0, 2.0)} == {"ok"}


def test_sensor_offset_stays_that_sensors_fault() -> None:
    """66 counts are 100 mG: a constant offset, without the motion that a moving field would show."""
    last = published(0.0, 3.0, offset_counts=66)[-220:]
    assert {message.health for message in last} == {"degraded"}
    assert all(message.reason.startswith("sensor 2 ") for message in last)
