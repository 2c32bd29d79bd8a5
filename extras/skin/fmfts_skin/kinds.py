"""The two kinds of contact models of this package, as the daemon asks for them (fmfts.config.model_kinds.ModelKind)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.config import PadConfig
from fmfts.config.section import Problem
from fmfts_skin.checks import skin_problems

if TYPE_CHECKING:
    from fmfts_skin.model import SkinForceModel, SkinModel
    from fmfts_skin.pipeline import SkinPipeline


class FieldResponses:
    """Tables from contact to field."""

    def problems(self, pad: PadConfig) -> Iterator[Problem]:
        return skin_problems(pad)

    def load(self, path: Path, sensors: int) -> SkinModel | SkinForceModel:
        from fmfts_skin.model import SkinModel

        return SkinModel.load(path, sensors)

    def pipeline(self, config: PadConfig, model: SkinModel | SkinForceModel, boot: str) -> SkinPipeline:
        from fmfts.pipeline.configured import hand_of, several_scene_of
        from fmfts_skin.pipeline import SkinPipeline

        per_k = config.magnet.temperature_coefficient_per_k
        rate_hz, ambient_t = float(config.source.rate_hz), several_scene_of(config).ambient_t
        hand, scene = hand_of(config), config.scene.solved
        return SkinPipeline(config.pad(), model, boot, rate_hz, ambient_t, per_k, hand, scene)


class ForceModels(FieldResponses):
    """Polynomials from field to force."""

    def load(self, path: Path, sensors: int) -> SkinModel | SkinForceModel:
        from fmfts_skin.model import SkinForceModel

        return SkinForceModel.load(path, sensors)


RESPONSES, FORCES = FieldResponses(), ForceModels()
