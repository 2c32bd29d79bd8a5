"""The predicted accuracy of a press of 1 N in the middle of a pad."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.contact import ContactModel
from fmfts.pipeline.configured import Pipeline
from fmfts.pipeline.drawn import NominalFrame
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pose.state import turned


def press_of_one_newton(pipeline: Pipeline) -> dict[str, float]:
    """Standard deviations of its place (m, the larger of x and y) and of its force (N), with the pipeline's baseline.

    The pose is as uncertain as at rest, plus the uncertainty of the magnet's movement through baseline and silicone.
    The contact model propagates that and adds its own error, as for every frame. Empty without a baseline at rest,
    without a contact model that holds the response of its pad, and for a pad of several magnets.
    """
    baselined, model = (pipeline.baselined, pipeline.model) if isinstance(pipeline, PadPipeline) else (None, None)
    if baselined is None or not isinstance(model, ContactModel) or model.response is None:
        return {}
    resting = baselined.resting()
    if resting is None:
        return {}
    press = np.zeros((1, 2 + model.response.loads))
    press[0, 2] = 1.0
    change = model.response.change(press)[0]
    state = resting.state
    pressed = replace(state, position_m=state.position_m + change[:3] * 1e-3, axis=turned(state.axis, change[3:]))
    estimate = replace(resting, state=pressed)
    drawing = baselined.drawing
    mounting = baselined.mounting
    nominal = NominalFrame(mounting.rest, drawing, baselined.change_error, drawing.silicone, mounting.pad_turn)
    contact = model.estimate(*nominal.pose(estimate), baselined.magnet_off_m)
    return {
        "middle_1n_place_sd_m": max(contact.x_sd_m, contact.y_sd_m),
        "middle_1n_force_sd_n": contact.force_sd_n,
    }


def gained(was: dict[str, float], now: dict[str, float]) -> dict[str, float]:
    """Both as one report: keys begin with `was_` and `now_`. Without a `was`, those of `now` as they are."""
    if not was:
        return now
    return {f"{when}_{name}": facts[name] for name in now for when, facts in (("was", was), ("now", now))}
