"""A whole session of a pad with four magnets says the same in C and in NumPy, to the last bit: frames to messages.

But for the alignment of the samples, which tests/oracle/test_sampling.py judges.

Nobody, one finger, two, one again, a sensor that is wrong, and nobody.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fmfts.offline.replay import essence
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.sensor import Frame
from fmfts.several import _several, estimator, field_model, fit, poses, scan, valley
from fmfts.simulation.array import SimulatedArray
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.finger import Finger, Touch
from fmfts_lab.finite_elements.array_pad import array_config
from twins.several import NumPyFitter, NumPyModel
from twins.several_poses import across_in_numpy, poses_in_numpy

RATE_HZ, FRAMES = 220, 58
CONFIG = array_config(seed=4)
BASELINE = simulated_baseline(CONFIG)


def pressing(from_frame: int, until_frame: int, x_m: float, y_m: float, force_n: float) -> Finger:
    """It comes and goes within four frames: chips on their own clocks see it at different times."""

    def finger(time_s: float) -> Touch:
        at = time_s * RATE_HZ
        share = min(max(min(at - from_frame, until_frame - at) / 4.0, 0.0), 1.0)
        return Touch(x_m, y_m, force_n * share)

    return finger


def frames() -> Iterator[Frame]:
    source = SimulatedArray(CONFIG)
    source.finger = pressing(5, 54, -6e-3, -1e-3, 0.8)
    source.second_finger = pressing(12, 24, 7e-3, 3e-3, 0.7)
    for step in range(FRAMES + 2):
        for frame in source.poll(step * round(1e9 / RATE_HZ)):
            if 28 <= frame.sequence < 31:
                counts = frame.counts.copy()
                counts[5] += np.array([270, 0, -270], dtype=np.int16)
                frame = replace(frame, counts=counts)
            yield frame


def session() -> list[str]:
    """Each message, but who made it and when it was sent."""
    pipeline = pipeline_of(CONFIG, contact_model_of(CONFIG), "boot")
    pipeline.use(BASELINE)
    said = [essence(pipeline.process(frame)) for frame in frames()]
    return [msgspec.json.encode(each).decode() for each in said]


def test_a_session_says_the_same_bits_in_c_and_in_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    in_c = session()
    monkeypatch.setattr(estimator, "FieldModel", NumPyModel)
    monkeypatch.setattr(estimator, "Fitter", NumPyFitter)
    monkeypatch.setattr(estimator, "poses_of", poses_in_numpy)
    monkeypatch.setattr(valley, "fitted_across", across_in_numpy)
    constants = SimpleNamespace(**{name: number for name, number in vars(_several).items() if name.isupper()})
    for module in (field_model, fit, poses, scan, valley):
        monkeypatch.setattr(module, "_several", constants)  # so that nothing can call a function of it
    in_numpy = session()
    assert len(in_c) == len(in_numpy) >= FRAMES
    assert [(one, other) for one, other in zip(in_c, in_numpy, strict=True) if one != other] == []
    # What the session is for is in it.
    fingers = [len(each["contacts"] or ()) for each in map(msgspec.json.decode, in_c)]
    assert {*fingers} == {0, 1, 2}
    assert any("sensor 6 contradicts all others" in line for line in in_c)
    assert '"health":"ok"' in in_c[-1]
