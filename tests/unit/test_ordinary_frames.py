"""A frame that the last one's fingers explain: one call of C says of it what the closer look of estimator.py says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fmfts.bus.messages import ContactMessage
from fmfts.pad import Array
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.sensor import Frame
from fmfts.several.estimator import FingersEstimator
from fmfts.several.trust import SETTLED_FRAMES
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_recording.replay import essence
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger
from fmfts_simulation.mounted_magnets import FieldOfFingers

CONFIG = array_config(seed=8)
COUNT, WHOLE = 150, 100  # frames; of the later ones, sensor 5 is silent
THIRD = Touch(0.0, 9e-3, 0.3)  # which two fingers explain in some frames
LEFT, RIGHT = steady_finger(-6e-3, -1e-3, 0.8), steady_finger(7e-3, 3e-3, 0.7)


def tapping(time_s: float) -> Touch:
    """Five times a second; its first force is in the newest samples before it is at a frame's instant."""
    return Touch(2e-3, -3e-3, max(0.0, 1.5 * math.sin(2.0 * math.pi * 5.0 * time_s)))


class WithThird(FieldOfFingers):
    """A simulated pad has two fingers; a third one presses beside them."""

    def at(self, place_m: Array, sampled_s: Array, fingers: Sequence[Finger], warmer: float) -> Array:
        return super().at(place_m, sampled_s, [*fingers, lambda _: THIRD], warmer)


def frames(finger: Finger, second: Finger | None, has_third: bool = False) -> list[Frame]:
    source = SimulatedArray(CONFIG)
    source.finger, source.second_finger = finger, second
    if has_third:
        source.fields = WithThird(source.inside)
    made = [frame for step in range(COUNT + 10) for frame in source.poll(round(step * 1e9 / 220))][:COUNT]
    return [*made[:WHOLE], *(replace(one, valid=one.valid & (np.arange(8) != 4)) for one in made[WHOLE:])]


def told(some: list[Frame], monkeypatch: pytest.MonkeyPatch, is_closer: bool) -> tuple[list[ContactMessage], int]:
    """The messages, and how many of the frames were ordinary."""
    made, ordinary = pipeline_of(CONFIG, contact_model_of(CONFIG), "boot"), 0
    assert isinstance(made, SeveralPipeline)
    made.use(simulated_baseline(CONFIG))
    estimator = made._estimator
    assert isinstance(estimator, FingersEstimator)
    goes_on = estimator.goes_on

    def counted(*given):  # type: ignore[no-untyped-def]
        nonlocal ordinary
        ordinary += 1
        goes_on(*given)

    monkeypatch.setattr(estimator, "goes_on", counted)
    if is_closer:
        estimator.calm_limits[:3] = -1.0  # no frame has so small a χ²
    return [made.process(one) for one in some], ordinary


@pytest.mark.parametrize(("finger", "second"), [(no_finger, None), (LEFT, None), (LEFT, RIGHT), (tapping, None)])
def test_closer_look_says_the_same(monkeypatch: pytest.MonkeyPatch, finger: Finger, second: Finger | None) -> None:
    some = frames(finger, second)
    said, ordinary = told(some, monkeypatch, is_closer=False)
    closer, none = told(some, monkeypatch, is_closer=True)
    assert ordinary > WHOLE / 4
    assert none == 0
    assert [essence(message) for message in said] == [essence(message) for message in closer]
    assert {message.health for message in said[10:WHOLE]} == {"ok"}
    assert said[-1].reason == "sensor 5 is silent"


def test_closer_look_says_the_same_of_a_third_finger(monkeypatch: pytest.MonkeyPatch) -> None:
    some = frames(LEFT, RIGHT, has_third=True)
    said, ordinary = told(some, monkeypatch, is_closer=False)
    closer, _ = told(some, monkeypatch, is_closer=True)
    assert 0 < ordinary < COUNT
    assert [essence(message) for message in said] == [essence(message) for message in closer]
    assert sum(message.more is True for message in said) >= 10


def test_fingers_that_are_not_settled_are_no_calm_frame() -> None:
    """They are degraded for a while, though the fingers of the last frame explain them."""
    made, some = pipeline_of(CONFIG, contact_model_of(CONFIG), "boot"), frames(LEFT, None)
    assert isinstance(made, SeveralPipeline)
    made.use(simulated_baseline(CONFIG))
    assert [made.process(one).health for one in some[:40]][-20:] == ["ok"] * 20
    assert isinstance(made._estimator, FingersEstimator)
    made._estimator.memory.unsettled = SETTLED_FRAMES
    assert [made.process(one).health for one in some[40:60]] == ["degraded"] * SETTLED_FRAMES + ["ok"] * 10
