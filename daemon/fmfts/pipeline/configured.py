"""From a pad's configuration to its pipeline: the daemon, a replay and `collect` all make pipelines here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fmfts.config import BridgeSource, PadConfig
from fmfts.contact import ContactModel, NoContactModel, OtherPadError
from fmfts.contact.no_model import NO_MODEL, no_model_for
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.pipeline.now import Lead
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.scene.neighbours import SceneNeighbour, neighbours_around
from fmfts.scene.tracking import scene_model_of
from fmfts.sensor.wire.packets import EARLY_BYTES, LINE_BITS_PER_BYTE, frame_bytes

# From a frame's last byte to its message, at the median, with a pad that is the only one (docs/results/latency.md).
HOST_S = 0.3e-3
# From the end of a conversion to when it is read: the way over the chip's bus, and the turns of the others.
READ_S = 0.4e-3


def load_contact_model(config: PadConfig, path: str | None = None) -> ContactModel:
    """The contact model at `path`, or the configured one if None. ModelError if it cannot serve this pad."""
    contact = config.contact
    return ContactModel.load(
        contact.model if path is None else path,
        config.pad(),
        refine=contact.refine,
        friction=contact.friction,
        smoothing_s=contact.smoothing_ms * 1e-3,
    )


def contact_model_of(config: PadConfig) -> ContactModel | NoContactModel:
    """The configured contact model. No model where the file asks for "none", or for a shipped one that does not fit.

    ModelError if another file is configured and cannot serve this pad.
    """
    name = config.contact.model
    if name == NO_MODEL:
        return no_model_for(name)
    try:
        return load_contact_model(config)
    except OtherPadError:
        if name not in SHIPPED_PATHS:
            raise
        return no_model_for(name)


def pipeline_of(config: PadConfig, model: ContactModel | NoContactModel, boot: str) -> PadPipeline:
    """A pipeline, still without a baseline. boot: written into each of its messages."""
    tracking = scene_model_of(config).tracking
    rate_hz = float(config.source.rate_hz)
    return PadPipeline(config.pad(), model, boot, rate_hz, tracking, lead_of(config))


def lead_of(config: PadConfig) -> Lead:
    """How old frames and samples are when their messages are published: the time on the line, and HOST_S."""
    source = config.source
    if isinstance(source, BridgeSource):
        byte_s = LINE_BITS_PER_BYTE / source.baud
        frame_s, early_s = byte_s * frame_bytes(len(config.geometry.sensors_mm)), byte_s * EARLY_BYTES
    else:
        # An I2C bus is polled twice a frame, and a sample is taken to be from the middle between two polls.
        frame_s, early_s = 0.0, 0.25 / source.rate_hz
    return Lead(HOST_S + frame_s, READ_S + HOST_S + early_s if source.publish == "sample" else 0.0)


def feel_neighbours(
    config: PadConfig, configs: Sequence[PadConfig], pipelines: Mapping[str, PadPipeline]
) -> list[SceneNeighbour]:
    """Tell the pipeline of `config` which neighbours it feels. Returns all neighbours that `config` names."""
    neighbours = list(neighbours_around(config, configs))
    for neighbour in neighbours:
        if neighbour.is_felt:
            pipelines[config.name].feel(pipelines[neighbour.name], neighbour.placement)
    return neighbours
