"""The pads of a model in this process: faster than real time, for learning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
from fmfts.baseline import Baseline
from fmfts.bus.encoding import encode
from fmfts.config import PadConfig
from fmfts.config.file import load
from fmfts.pipeline.configured import contact_model_of, feel_neighbours, lead_of, pipeline_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor.frame import Frame

from fmfts_mujoco.boards import NS, START_S, Faults
from fmfts_mujoco.scene import Scene
from fmfts_mujoco.setting_up import baselines
from fmfts_mujoco.told import Told

SILENT_S, REPEAT_S = 0.15, 0.1  # as in the daemon: then a pad is silent, and repeats that at this interval
UNPLUGGED = "its board does not answer: it is unplugged"


class Pads:
    """What a robot's program reads of the pads in `model`: `step` after each `mj_step`, `contacts` whenever it wants.

    The clock of the messages is that of the simulation: compare their times with `now_ns`.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        pads: Sequence[PadConfig] | Path | str,
        recorded: Mapping[str, Baseline] | None = None,
        *,
        as_built: bool = False,
    ) -> None:
        """pads: the daemon's configuration, or its file. data: how the robot stands while its baselines are recorded;
        recorded: earlier baselines of the same pads. as_built: pads differ from their drawing as their tolerances say,
        after each `reset` by other silicone and fingers. ModelError where the model lacks a pad; ConfigError."""
        mujoco.mj_forward(model, data)
        configs = load(Path(pads))[0].pad if isinstance(pads, str | Path) else pads
        self.scene = Scene(model, configs, as_built=as_built)
        self.baselines = dict(recorded) if recorded is not None else baselines(self.scene, data)
        self._names = [pad.name for pad in configs]
        self._pipelines: dict[str, PadPipeline] = {}
        for pad in configs:
            pipeline = pipeline_of(pad, contact_model_of(pad), "mujoco")
            assert isinstance(pipeline, PadPipeline)  # a pad with one magnet, as `Scene` demands
            pipeline.use(self.baselines[pad.name])
            self._pipelines[pad.name] = pipeline
        for pad in configs:
            feel_neighbours(pad, configs, self._pipelines)
        self._late_ns = [round(lead_of(pad).frame_s * NS) for pad in configs]
        self.reset()

    def reset(self, seed: int | np.random.Generator = 0) -> None:
        """Switch everything on again, with other noise: the pads remember nothing. The same seed gives the same
        messages."""
        self.scene.start(np.random.default_rng(seed))
        for pipeline in self._pipelines.values():
            pipeline.start_anew()
        self._told = [Told() for _ in self._names]
        self._heard_ns = [NS] * len(self._names)
        self._recorded_s = 0.0

    @property
    def faults(self) -> dict[str, Faults]:
        """The faults of each pad; may be changed at any time."""
        return self.scene.faults

    @property
    def now_ns(self) -> int:
        """The time on the clock of the messages."""
        return round((self._recorded_s + START_S) * NS)

    def step(self, data: mujoco.MjData) -> None:
        """Take over the step that `mj_step` just did."""
        self._recorded_s = self.scene.record(data)

    def contacts(self) -> dict[str, Told]:
        """The messages of each pad that were published since the last call, in order."""
        for number, frames in enumerate(self.scene.frames()):
            self._judge(number, frames)
        contacts, now_ns = {}, self.now_ns
        for number, name in enumerate(self._names):
            contacts[name], self._told[number] = self._told[number].split(now_ns)
        return contacts

    def _judge(self, number: int, frames: list[Frame]) -> None:
        pipeline, told = self._pipelines[self._names[number]], self._told[number]
        period_ns, start_ns = NS / self.scene.boards.rate_hz, round(START_S * NS)
        published_ns = start_ns + self._late_ns[number]
        told.extend(
            [published_ns + round(frame.sequence * period_ns) for frame in frames],
            [pipeline.payload(frame) for frame in frames],
        )
        if frames:
            self._heard_ns[number] = start_ns + round(frames[-1].sequence * period_ns)
        while self.now_ns - self._heard_ns[number] > SILENT_S * NS:
            self._heard_ns[number] += round(REPEAT_S * NS)
            told.extend([self._heard_ns[number]], [encode(pipeline.absent("disconnected", UNPLUGGED))])
