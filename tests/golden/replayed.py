"""Pushes a frozen world through the product's pipelines as the daemon does, and collects their messages."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, PadConfig
from fmfts.pipeline.configured import Pipeline, contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.snapshot import restore, snapshot
from fmfts.sensor.early import EarlySample
from golden.said import Said
from golden.world import World, WorldPad


@dataclass(frozen=True, slots=True)
class Way:
    """snapshots: take a pad's state after this many frames, as when a recording begins; 0: never.

    anew: the frame of the first pad from which other pipelines continue with the states of all, as in a replay; 0:
    never.
    """

    snapshots: int = 0
    anew: int = 0


AS_ALWAYS = Way()


def replay(world: World, messages: int | None = None, way: Way = AS_ALWAYS) -> dict[str, Said]:
    """The messages of each pad. messages: at most this many of each pad."""
    said = {pad.settings.name: Said() for pad in world.pads}
    for name, message, sent_ns in answers(world, way):
        if messages is None or len(said[name].words) < messages:
            said[name].add(message, sent_ns)
        elif all(len(each.words) >= messages for each in said.values()):
            break
    return said


def answers(world: World, way: Way = AS_ALWAYS) -> Iterator[tuple[str, ContactMessage | None, int]]:
    """Yields the message for each arrival, with its pad, and the time of its sample on the host's clock.

    None: a sample that came before its frame, and contains nothing new.
    """
    with ExitStack() as folders:
        pipelines = folders.enter_context(pipelines_of(world))
        first, numbers = next(iter(pipelines)), dict.fromkeys(pipelines, 0)
        for name, event in world.events():
            if isinstance(event, EarlySample):
                answer = pipelines[name].early(event)
                sent_ns = pipelines[name].host_time_ns(event.device_time_us)
            else:
                numbers[name] += 1
                if way.snapshots and numbers[name] % way.snapshots == 0:
                    snapshot(pipelines[name])
                if name == first and numbers[name] == way.anew:
                    pipelines = _anew(pipelines, folders.enter_context(pipelines_of(world)))
                answer, sent_ns = pipelines[name].answer(event), event.host_time_ns
            yield name, None if answer is None else message_of(answer), sent_ns


def _anew(pipelines: dict[str, Pipeline], others: dict[str, Pipeline]) -> dict[str, Pipeline]:
    for name, pipeline in pipelines.items():
        restore(others[name], snapshot(pipeline))
    return others


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
    """A skin's contact model is written into a file."""
    settings = pad.settings
    if pad.response is None:
        return settings
    path = folder / f"{settings.name}.response"
    path.write_bytes(pad.response)
    return msgspec.structs.replace(settings, contact=ContactConfig(model=str(path)))
