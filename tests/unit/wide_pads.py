"""Pads with more sensors than a board carries."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from fmfts.baseline import Baseline
from fmfts.config import GeometryConfig, PadConfig
from fmfts.contact import ContactModel
from fmfts.pad import SensorArray
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.scene.tracking import tracking_model_for

# A grid, its inner places first: with fewer sensors than sixteen the outer ones are missing.
_GRID = [(x, y) for x in (-13.5, -4.5, 4.5, 13.5) for y in (-13.5, -4.5, 4.5, 13.5)]
PLACES_MM = sorted(_GRID, key=lambda place: place[0] * place[0] + place[1] * place[1])


def with_sensors(config: PadConfig, sensors: int) -> PadConfig:
    """The same pad over the first `sensors` places of the grid. One magnet above them has up to 5 G at a chip."""
    places = tuple((x, y, 0) for x, y in PLACES_MM[:sensors])
    source = msgspec.structs.replace(config.source, range_gauss=8.1)
    return msgspec.structs.replace(config, source=source, geometry=GeometryConfig(sensors_mm=places))


def pipeline_with_default_model(config: PadConfig, baseline: Baseline) -> PadPipeline:
    """A pipeline with the default contact model, made for the same magnet over four sensors: it needs the pose
    alone.
    """
    pad = config.pad()
    standard = SensorArray.aligned(PadConfig(name="standard", source=config.source).pad().sensors.position_m)
    model = ContactModel.load("default", replace(pad, sensors=standard))
    tracking = tracking_model_for(config.scene, config.magnet).tracking
    pipeline = PadPipeline(pad, model, "boot", float(config.source.rate_hz), tracking)
    pipeline.use(baseline)
    return pipeline
