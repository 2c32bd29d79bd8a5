"""Makes a pad's parts before its first frame: contact model, source, pipeline, baseline, neighbours."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.files import StateError, stored
from fmfts.baseline.origin import unbound
from fmfts.baseline.recording import ForeignError
from fmfts.bus.publisher import Publisher
from fmfts.config import Config, PadConfig, ReplaySource, SimulatedSource, neighbours_of
from fmfts.config.checks import other_silicone
from fmfts.config.neighbour_checks import unnamed_neighbours
from fmfts.contact import ContactModel, ModelError, NoContactModel
from fmfts.contact.unknown_finger import unknown_finger
from fmfts.pad import Pad
from fmfts.pipeline.configured import AnyModel, Pipeline, contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.channel import Channel
from fmfts.runtime.failure import sentence_of
from fmfts.runtime.guarded import LONGEST_PAUSE_S, GuardedSource, device_of
from fmfts.scene.tracking import observability_warnings, scene_model_of
from fmfts.sensor import Source, SourceError
from fmfts.sensor.source import LackingError
from fmfts.sources import Device, origin_of, recorded_baseline, simulation

log = logging.getLogger(__name__)

NEIGHBOURS_WITHOUT_BARE = (
    "it has neighbours, and its baseline no bare recording, so their fields count as errors of mounting: "
    "`fmfts-daemon baseline --bare` without this pad and with its neighbours, then `--rest`"
)


def open_guarded(
    devices: Sequence[Device], rates_hz: Mapping[str, float] | None = None
) -> list[tuple[GuardedSource, Mapping[int, str]]]:
    """A guarded source for each device. A recording that cannot be read is tried again later.

    rates_hz: the nominal ones, by pad. A recording may have another rate, and may be played faster.
    SourceError if a device cannot do what is configured, or if nothing at all can be read.
    """
    opened: list[tuple[GuardedSource, Mapping[int, str]]] = []
    for device in devices:
        rate_hz = None if rates_hz is None or device.is_file else sum(rates_hz[name] for name in device.names.values())
        source = GuardedSource(device.open, device.names, device.description, rate_hz)
        try:
            source.open()
        except SourceError as error:
            if not device.is_file or isinstance(error, LackingError):
                raise
            source.fail("its constructor", error)
            log.error("%s: %s; it is tried again every %g s", ", ".join(device.names.values()), error, LONGEST_PAUSE_S)
        opened.append((source, device.names))
    if all(source.device is None for source, _ in opened):
        raise SourceError("\n".join(source.state.reason for source, _ in opened))
    return opened


def load_models(config: Config) -> dict[str, AnyModel]:
    """The contact models by pad; pads of the same structure share one. ModelError if a model's file cannot be used."""
    loaded: dict[tuple[object, ...], AnyModel] = {}
    models = {}
    wrong: list[str] = []
    for pad in config.pad:
        key = (pad.contact, pad.pad().geometry_hash)
        try:
            if key not in loaded:
                loaded[key] = contact_model_of(pad)
            models[pad.name] = loaded[key]
        except ModelError as error:
            wrong.append(str(error))
    if wrong:
        raise ModelError("\n".join(wrong))
    return models


def tell_models(config: Config, models: Mapping[str, AnyModel]) -> None:
    """Log each pad's contact model, and its limits."""
    for pad in config.pad:
        model = models[pad.name]
        if isinstance(model, NoContactModel):
            told = f"{model.tells}, no place and no force: {model.reason}"
            log.warning("pad '%s': it publishes %s", pad.name, told)
            if pad.rebaseline.enabled:
                log.warning("pad '%s': [pad.rebaseline] needs forces, so no drift is followed", pad.name)
            continue
        log.info("pad '%s': contact model %s, SHA-256 %s…, %s", pad.name, pad.contact.model, model.hash, model.told)


def channel_of(
    config: PadConfig,
    source: Source,
    pad_index: int,
    model: AnyModel,
    publisher: Publisher,
    boot: str,
    pads: Sequence[PadConfig],
) -> Channel:
    """The channel of a pad with its baseline; without a fitting one, it reports that and waits for one.

    pads: all that are configured.
    """
    pipeline = pipeline_of(config, model, boot)
    pad = pipeline.pad
    if isinstance(pipeline, PadPipeline):
        scene = scene_model_of(config)
        log.info("pad '%s': %s", pad.name, scene.why)
        for text in observability_warnings(pad, scene.tracking):
            log.warning("pad '%s': %s", pad.name, text)
    for text in unnamed_neighbours(config, pads):
        log.warning("pad '%s': %s", pad.name, text)
    if isinstance(model, ContactModel):
        for doubt in (other_silicone(config), unknown_finger(model)):
            if doubt is not None:
                log.warning("pad '%s': %s", pad.name, doubt)
    channel = Channel(source, pad_index, pipeline, publisher, boot, float(config.source.rate_hz))
    channel.recorders.config, channel.baseline.origin = config, origin_of(config)
    use_baseline(channel, config, pads)
    return channel


def use_baseline(channel: Channel, config: PadConfig, pads: Sequence[PadConfig]) -> None:
    """Use the pad's stored, recorded or simulated baseline. Without one that fits, the pad publishes why."""
    pipeline, pad = channel.pipeline, channel.pipeline.pad
    try:
        if isinstance(config.source, ReplaySource):
            recording = device_of(channel.source)
            if recording is None:  # the recording cannot be read now, nor its baseline
                return
            baseline = recorded_baseline(recording, channel.pad_index)
        else:
            baseline = _stored(config, pad)
        if baseline is None and isinstance(config.source, SimulatedSource):
            baseline = simulation("baseline")(config, neighbours_of(config, pads))
            log.info("pad '%s': simulated, so its baseline is computed at once", pad.name)
        if baseline is None:
            log.warning("pad '%s': no baseline yet: `fmfts-daemon baseline --bare`, then `--rest`", pad.name)
        elif baseline != pipeline.baseline:  # a recording that is played again mostly has the same baseline
            channel.use(baseline)
            if (
                channel.baseline.origin is not None
                and baseline.origin is None
                and not isinstance(config.source, SimulatedSource)
            ):
                log.warning("%s", unbound(pad.name))
    except BaselineError as error:
        log.error("%s", error)
        pipeline.refuse(str(error))
    except StateError:  # the folder for baselines is absent, which concerns all pads
        raise
    except Exception as error:
        log.exception("pad '%s': internal error with its baseline, worth reporting", pad.name)
        pipeline.refuse(f"its baseline cannot be used: internal error: {sentence_of(error)}")


def introduce_neighbours(pads: Sequence[PadConfig], pipelines: Mapping[str, Pipeline]) -> None:
    """Give each pad the magnets of its neighbours."""
    for pad in pads:
        for neighbour in feel_neighbours(pad, pads, pipelines):
            log.info("pad '%s': %s", pad.name, neighbour.why)
        baseline = pipelines[pad.name].baseline
        if pad.scene.neighbours and baseline is not None and baseline.bare is None:
            log.warning("pad '%s': %s", pad.name, NEIGHBOURS_WITHOUT_BARE)


def _stored(config: PadConfig, pad: Pad) -> Baseline | None:
    """The stored baseline of the pad. A simulated pad uses only a baseline of its own sensors."""
    try:
        return stored(pad, origin_of(config))
    except ForeignError as error:
        if not isinstance(config.source, SimulatedSource):
            raise
        log.warning("%s; until then the pad uses a simulated baseline", error)
        return None
