"""One press in the daemon's own simulation, and by the boards of this package: the frames, and the messages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.sensor.frame import Frame
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import steady_finger
from fmfts_simulation.source import Simulated

from fmfts_mujoco.boards import NS, Boards, built_of
from fmfts_mujoco.history import History
from fmfts_mujoco.stacked import Stacked

FRAMES, BEGUN = 600, 50  # the pipeline uses the first ones to find the ambient field
NUMBERS = ("force_n", "x_m", "y_m", "force_sd_n", "x_sd_m", "y_sd_m")
Press = tuple[float, float, float]  # x, y in m, force in N


def daemons(pad: PadConfig, press: Press) -> list[Frame]:
    """Frames of the daemon's simulation of a pad that stands still."""
    source = Simulated(pad)
    source.turning_rad_per_s = 0.0
    source.finger = steady_finger(*press)
    return [frame for number in range(FRAMES) for frame in source.poll(number * NS // pad.source.rate_hz + 1)]


def boards(pad: PadConfig, press: Press) -> list[Frame]:
    """Frames of this package's boards, in the ambient field in which the daemon simulates the pad."""
    built = built_of(pad)
    stacked, sensors = Stacked([built]), len(built.pad.sensors)
    moved, around = History(1, 5), History(1, sensors, 3)
    moved.add(np.zeros(1), built.response(*(np.array([value]) for value in press))[None])
    around.add(np.zeros(1), np.tile(built.ambient_t, (1, 1, sensors, 1)))
    return Boards([pad], stacked).frames((FRAMES - 0.5) / pad.source.rate_hz, moved, around)[0]


def messages(pad: PadConfig, frames: Sequence[Frame]) -> Array:
    """The numbers (M, NUMBERS) of the messages, with one baseline for all. AssertionError where one is not ok."""
    pipeline = pipeline_of(pad, contact_model_of(pad), "alike")
    pipeline.use(simulated_baseline(pad))
    told = [pipeline.process(frame) for frame in frames][BEGUN:]
    assert {message.health for message in told} == {"ok"}
    return np.array([[getattr(message, name) for name in NUMBERS] for message in told])


def alike(pad: PadConfig, press: Press) -> tuple[Array, Array, Array]:
    """For force and place, each (3,): the difference of the means in deviations of one frame's noise; the ratio of both
    noises; the ratio of the published deviations."""
    one, other = (messages(pad, make(pad, press)) for make in (daemons, boards))
    noise, other_noise = one[:, :3].std(axis=0), other[:, :3].std(axis=0)
    apart = np.abs(other[:, :3].mean(axis=0) - one[:, :3].mean(axis=0)) / noise
    return apart, other_noise / noise, other[:, 3:].mean(axis=0) / one[:, 3:].mean(axis=0)
