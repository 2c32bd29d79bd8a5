"""What was known of a pad before `baseline --rest --replaced`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fmfts.baseline import Baseline, BaselineError
from fmfts.config import PadConfig
from fmfts.contact import ModelError
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.sensor import Frame

MOSTLY = 0.95  # of the frames of the recording's second half: its first half lets filters settle


@dataclass(frozen=True, slots=True)
class ConfiguredPad:
    """A `LastPad`."""

    config: PadConfig

    @property
    def unweighed(self) -> float:
        return self.config.structure_tolerance().scale_deviation

    def pressed_n(self, frames: Sequence[Frame], before: Baseline) -> float | None:
        if not self.config.are_magnets_known:
            return None  # another package judges such frames, and has no measure of a moved magnet
        try:
            pipeline = pipeline_of(self.config, contact_model_of(self.config), boot="")
            pipeline.use(before)
        except (BaselineError, ModelError):
            return None
        told = [pipeline.process(frame) for frame in frames][len(frames) // 2 :]
        forces_n = [one.force_n for one in told if one.contact and one.force_n is not None]
        return sum(forces_n) / len(forces_n) if told and len(forces_n) >= MOSTLY * len(told) else None
