"""Pushes a frozen world through the product's pipelines as the daemon does, and gathers what they say."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, PadConfig
from fmfts.pipeline.configured import Pipeline, contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.contact_message import PackedMessage
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import snapshot
from fmfts.sensor.early import EarlySample
from golden.said import Said
from golden.world import World, WorldPad


@dataclass(frozen=True, slots=True)
class Way:
    """How frames are judged. in_c: by the compiled path where it can. snapshots: after how many frames of a pad its
    state is taken, as where somebody begins to record; 0: never."""

    in_c: bool = True
    snapshots: int = 0


AS_ALWAYS = Way()


def replay(world: World, messages: int | None = None, way: Way = AS_ALWAYS) -> dict[str, Said]:
    """What each pad says. messages: of each pad at most so many."""
    said = {pad.settings.name: Said() for pad in world.pads}
    for name, message, sent_ns in answers(world, way):
        if messages is None or len(said[name].words) < messages:
            said[name].add(message, sent_ns)
        elif all(len(each.words) >= messages for each in said.values()):
            break
    return said


def answers(world: World, way: Way = AS_ALWAYS) -> Iterator[tuple[str, ContactMessage | None, int]]:
    """Yields the message of all that arrives, with its pad, and when it was sampled, on the host's clock.

    None: a sample that came before its frame, and says nothing new.
    """
    with pipelines_of(world) as pipelines:
        for pipeline in pipelines.values():
            if isinstance(pipeline, PadPipeline) and pipeline._estimator is not None and not way.in_c:
                pipeline._estimator._path = None
        numbers = dict.fromkeys(pipelines, 0)
        for name, event in world.events():
            pipeline = pipelines[name]
            if isinstance(event, EarlySample):
                answer = pipeline.early(event)
                sent_ns = pipeline.host_time_ns(event.device_time_us)
            else:
                numbers[name] += 1
                if way.snapshots and numbers[name] % way.snapshots == 0:
                    snapshot(pipeline)
                answer, sent_ns = pipeline.answer(event), event.host_time_ns
            yield name, answer.message if isinstance(answer, PackedMessage) else answer, sent_ns


@contextmanager
def pipelines_of(world: World) -> Iterator[dict[str, Pipeline]]:
    """The pads' pipelines with their baselines, as the daemon makes them."""
    with tempfile.TemporaryDirectory() as folder:
        configs = [_settings(pad, Path(folder)) for pad in world.pads]
        pipelines = {each.name: pipeline_of(each, contact_model_of(each), "golden") for each in configs}
        for config in configs:
            feel_neighbours(config, configs, pipelines)
        for config, pad in zip(configs, world.pads, strict=True):
            if pad.baseline is not None:
                pipelines[config.name].use(msgspec.convert(pad.baseline, Baseline))
        yield pipelines


def _settings(pad: WorldPad, folder: Path) -> PadConfig:
    """A skin's contact model is put into a file."""
    settings = pad.settings
    if pad.response is None:
        return settings
    path = folder / f"{settings.name}.response"
    path.write_bytes(pad.response)
    return msgspec.structs.replace(settings, contact=ContactConfig(model=str(path)))
