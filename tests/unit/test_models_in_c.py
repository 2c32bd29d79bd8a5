"""A contact model that tells shear, smoothing, and no model, in C: the same messages as by the stages in Python."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_healthy_path import compared, python_only, with_faults
from test_pipeline import PERIOD_NS, config_of

from fmfts.baseline import Baseline
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.contact.no_model import no_model_for
from fmfts.pipeline.contact_message import PackedMessage
from fmfts.pipeline.fast import Kind
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor import Frame
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.finger import Touch, no_finger
from fmfts.simulation.source import Simulated

MODELS = {
    "shear": {"path": "shear"},
    "shear, refined": {"path": "shear", "refine": True},
    "smoothed": {"path": "default", "smoothing_s": 0.02},
    "shear, smoothed": {"path": "shear", "smoothing_s": 0.1},
    "none": {"path": "none"},
}


def pipelines(config: PadConfig, baseline: Baseline, model: str) -> tuple[PadPipeline, PadPipeline]:
    """One that C serves, and the oracle."""
    pad, scene = config.pad(), tracking_model_for(config.scene, config.magnet)
    options = dict(MODELS[model])
    path = str(options.pop("path"))
    found = []
    for _ in range(2):
        loaded = no_model_for("none") if path == "none" else ContactModel.load(path, pad, **options)  # type: ignore[arg-type]
        found.append(PadPipeline(pad, loaded, "boot", 220.0, scene.tracking))
        found[-1].use(baseline)
    return found[0], python_only(found[1])


def pressed(config: PadConfig, seconds: float) -> list[Frame]:
    """Presses at one place after the other, also at the edge and beyond, harder and harder, with pauses."""
    source = Simulated(config)

    def finger(time_s: float) -> Touch:
        at = int(time_s / 0.25)
        ramp = min(time_s % 0.25, 0.05) / 0.05
        places = [(0.0, 0.0), (4e-3, -2e-3), (-8e-3, 6e-3), (11e-3, 11e-3)]
        x_m, y_m = places[at % len(places)]
        return no_finger(time_s) if time_s % 0.25 > 0.17 else Touch(x_m, y_m, (0.3 + 0.35 * (at % 7)) * ramp)

    source.finger = finger
    return [frame for step in range(round(seconds * 220)) for frame in source.poll(step * PERIOD_NS)]


LONG = pytest.mark.long


@pytest.mark.parametrize("model", [pytest.param(model, marks=LONG if "," in model else ()) for model in MODELS])
def test_a_session_says_the_same_in_c_and_in_python(model: str) -> None:
    config = config_of(31)
    kinds = compared(*pipelines(config, simulated_baseline(config), model), pressed(config, 1.6))
    assert kinds[Kind.QUIET] > 60
    assert kinds[Kind.TOUCHED] > 90
    # Where shear cannot be told from place, Python says so.
    assert kinds[None] < (30 if model == "smoothed" else 150)


@LONG
@pytest.mark.parametrize("model", ["shear", "smoothed", "none"])
def test_a_session_with_faults_says_the_same_and_comes_back(model: str) -> None:
    config = config_of(32)
    source = Simulated(config)
    frames = [frame for step in range(16 * 110) for frame in source.poll(step * PERIOD_NS)][: 12 * 110]
    kinds = compared(*pipelines(config, simulated_baseline(config), model), with_faults(frames))
    assert kinds[None] > 150
    assert kinds[Kind.QUIET] + kinds[Kind.TOUCHED] > 400


def test_the_memory_of_a_filter_goes_to_c_and_back() -> None:
    """A frame in ten has a saturated axis, so Python and C take turns."""
    config = config_of(34)
    frames = [
        replace(frame, counts=np.where(np.arange(12).reshape(4, 3) == 5, -4096, frame.counts).astype(np.int16))
        if number % 10 == 9
        else frame
        for number, frame in enumerate(pressed(config, 0.9))
    ]
    kinds = compared(*pipelines(config, simulated_baseline(config), "shear, smoothed"), frames)
    assert kinds[None] > 50
    assert kinds[Kind.QUIET] + kinds[Kind.TOUCHED] > 50


def test_messages_of_c_tell_shear() -> None:
    config = config_of(33)
    pipeline, _ = pipelines(config, simulated_baseline(config), "shear")
    source = Simulated(config)
    source.finger = lambda time_s: Touch(1e-3, 1e-3, 0.8) if time_s > 0.4 else no_finger(time_s)
    answers = [pipeline.answer(frame) for step in range(220) for frame in source.poll(step * PERIOD_NS)]
    last = answers[-1]
    assert isinstance(last, PackedMessage)
    message, now = last.message, last.message.now
    assert message.shear_x_n is not None
    assert message.shear_y_sd_n is not None
    assert abs(message.shear_x_n) < 5.0 * (message.shear_x_sd_n or 0.0)
    assert now is not None
    assert now.shear_y_rate_n_per_s is not None
