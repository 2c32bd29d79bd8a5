"""From a pad's configuration to its pipeline: the daemon, a replay and `collect` all make pipelines here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline import BaselineError
from fmfts.baseline.posture import PostureLearner
from fmfts.config import BridgeSource, PadConfig
from fmfts.contact import ContactModel, NoContactModel, OtherPadError
from fmfts.contact.array_model import ARRAY_PATH, ArrayModel
from fmfts.contact.no_model import NO_MODEL, no_model_for
from fmfts.contact.plugged import PluggedModel
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.plugged import PluggedPipeline
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.pose.hand import Hand
from fmfts.pose.observable import are_observable, needed_sensors
from fmfts.scene.neighbours import SceneNeighbour, neighbours_around
from fmfts.scene.tracking import (
    AMBIENT_DEVIATION_T,
    AMBIENT_WALK_T2_PER_S,
    COEFFICIENT_SHARE,
    HOTTER_K,
    MOMENT_DEVIATION,
    UNREAD_WARMING_K,
    scene_model_of,
)
from fmfts.sensor.wire.packets import EARLY_BYTES, LINE_BITS_PER_BYTE, frame_bytes
from fmfts.several.field_model import Scene

AnyModel = ContactModel | NoContactModel | ArrayModel | PluggedModel
Pipeline = PadPipeline | SeveralPipeline | PluggedPipeline
DEFAULT_MODEL = "default"
# Deviation of the ambient field since the baseline, along each axis, while a robot turns: a pad with several magnets
# estimates it in each frame.
TURNING_T = 1e-4
# Median time from a frame's last byte to its message, with a single pad (lab/results/latency.md).
HOST_S = 0.3e-3
# Time from the end of a conversion to its reading: the transfer over the chip's bus, and the transfers of the other
# chips.
READ_S = 0.4e-3


def load_contact_model(config: PadConfig, path: str | None = None) -> ContactModel:
    """The contact model at `path`, or the configured one if None. ModelError if it cannot serve this pad."""
    contact = config.contact
    friction = max(contact.friction, contact.slip_friction[1]) if contact.slip else contact.friction
    return ContactModel.load(
        contact.model if path is None else path,
        config.pad(),
        refine=contact.refine,
        friction=friction,
        smoothing_s=contact.smoothing_ms * 1e-3,
        tolerance=config.structure_tolerance(path),
        slip_friction=contact.slip_friction if contact.slip else None,
    )


def load_array_model(config: PadConfig, path: str) -> ArrayModel:
    """The contact model at `path` of a pad with several magnets. ModelError if it cannot serve this pad."""
    return ArrayModel.load(ARRAY_PATH if path == DEFAULT_MODEL else Path(path), config.pad())


def load_any_model(config: PadConfig, path: str) -> ContactModel | ArrayModel | PluggedModel:
    """The contact model at `path`, of the kind that this pad needs. ModelError if it cannot serve this pad."""
    if config.model_kind is not None:
        return config.model_kind.load(Path(path), len(config.geometry.sensors_mm))
    return load_array_model(config, path) if config.other_magnets else load_contact_model(config, path)


def contact_model_of(config: PadConfig) -> AnyModel:
    """The configured contact model. No model if the file has "none", or a shipped one that does not fit.

    ModelError if another file is configured and cannot serve this pad, or if a pad with several magnets has none, and
    too few sensors to estimate the poses without one.
    """
    name, magnets = config.contact.model, 1 + len(config.other_magnets)
    if name == NO_MODEL:
        return no_model_for(name, magnets)
    try:
        return load_any_model(config, name)
    except OtherPadError as error:
        if name not in SHIPPED_PATHS:
            raise
        if magnets > 1 and not are_observable(magnets, len(config.geometry.sensors_mm)):
            enough = needed_sensors(magnets)
            raise OtherPadError(f"{error}. With {enough} sensors it can publish touch and poses alone") from error
        return no_model_for(name, magnets)


def pipeline_of(config: PadConfig, model: AnyModel, boot: str) -> Pipeline:
    """A pipeline, still without a baseline. boot: written into each of its messages."""
    if config.model_kind is not None:
        pipeline: PluggedPipeline = config.model_kind.pipeline(config, model, boot)
        return pipeline
    rate_hz = float(config.source.rate_hz)
    if isinstance(model, ArrayModel) or (config.other_magnets and isinstance(model, NoContactModel)):
        per_k = config.magnet.temperature_coefficient_per_k
        scene, hand = several_scene_of(config), hand_of(config)
        lead = lead_of(config)
        return SeveralPipeline(config.pad(), model, boot, rate_hz, scene, per_k, hand=hand, lead=lead)
    assert isinstance(model, ContactModel | NoContactModel)
    tracking = scene_model_of(config).tracking
    return PadPipeline(config.pad(), model, boot, rate_hz, tracking, lead=lead_of(config), hand=hand_of(config))


def hand_of(config: PadConfig) -> Hand | None:
    """The hand whose posture the pad's field depends on; None: there is none."""
    return Hand(3 * len(config.geometry.sensors_mm)) if config.scene.ambient == "posture" else None


def posture_learner(config: PadConfig, no_joints: bool = False) -> PostureLearner:
    """The setting for `baseline --posture`. BaselineError if the pad's scene has no posture."""
    if config.scene.ambient != "posture":
        raise BaselineError(
            f"pad '{config.name}': nothing would use what a posture does to its field: set ambient = \"posture\" in "
            "[pad.scene], and start the daemon again (docs/scene.md#a-hand-that-moves)"
        )
    return PostureLearner(without_joints=no_joints)


def lead_of(config: PadConfig) -> Lead:
    """Ages of frames and samples when their messages are published: the time on the line, and HOST_S."""
    source = config.source
    if isinstance(source, BridgeSource):
        byte_s = LINE_BITS_PER_BYTE / source.baud
        frame_s, early_s = byte_s * frame_bytes(len(config.geometry.sensors_mm)), byte_s * EARLY_BYTES
    else:
        # An I2C bus is polled twice a frame, and a sample is taken to be from the middle between two polls.
        frame_s, early_s = 0.0, 0.25 / source.rate_hz
    return Lead(HOST_S + frame_s, READ_S + HOST_S + early_s if source.publish == "sample" else 0.0)


def several_scene_of(config: PadConfig) -> Scene:
    """Other causes of a change of field, for a pad with several or unknown magnets."""
    moves = config.scene.ambient != "constant" or config.scene.steel_nearby
    warming_k = HOTTER_K if config.scene.remanence == "drifting" else COEFFICIENT_SHARE * UNREAD_WARMING_K
    per_k = config.magnet.temperature_coefficient_per_k
    moment = float(root_of_squares(MOMENT_DEVIATION, per_k * warming_k))
    ambient_t = TURNING_T if moves else AMBIENT_DEVIATION_T
    walk_t2_per_s = AMBIENT_WALK_T2_PER_S if moves else 0.0
    return Scene(ambient_t, moment, config.contact.friction, config.structure_tolerance().force_share, walk_t2_per_s)


def feel_neighbours(
    config: PadConfig, configs: Sequence[PadConfig], pipelines: Mapping[str, Pipeline]
) -> list[SceneNeighbour]:
    """Tell the pipeline of `config` which neighbours its sensors measure. Returns all neighbours that `config`
    names."""
    neighbours = list(neighbours_around(config, configs))
    for neighbour in neighbours:
        if neighbour.is_felt:
            pipelines[config.name].feel(pipelines[neighbour.name].be_felt(), neighbour.placement)
    return neighbours
