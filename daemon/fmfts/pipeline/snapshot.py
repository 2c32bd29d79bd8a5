"""What a pipeline remembers of the frames before, as bytes: a recording that begins in the middle of a touch holds it.

A replay goes on from there bit for bit. Each filter declares its memory beside its equations (`…Memory`);
`PipelineMemory` is all of them. Memories of format 1, which had no number, are read, too: snapshot_v1.py.
"""

from __future__ import annotations

import time

import msgspec

from fmfts.baseline import Baseline, Mounting
from fmfts.bus.messages import StateMessage
from fmfts.common.memory import convert, decode, encode
from fmfts.config import PadConfig
from fmfts.pipeline import snapshot_v1
from fmfts.pipeline.pad_pipeline import PadPipeline, PipelineMemory
from fmfts.pose import SOLVER

FORMAT = 2
LARGEST = 1 << 20


class BadMemoryError(ValueError):
    """A memory does not belong to this pipeline, or is damaged."""


class Snapshot(msgspec.Struct):
    format: int
    memory: msgspec.Raw


def state_message(pipeline: PadPipeline, config: PadConfig, boot: str) -> StateMessage:
    """All that a replay of the frames that follow needs."""
    baseline = pipeline.baseline
    return StateMessage(
        pad=pipeline.pad.name,
        boot=boot,
        utc_ns=time.time_ns(),
        config=msgspec.to_builtins(config),
        model=pipeline.model_hash,
        solver=SOLVER,
        baseline=None if baseline is None else msgspec.to_builtins(baseline),
        memory=snapshot(pipeline),
    )


def snapshot(pipeline: PadPipeline) -> bytes:
    """The next frame is judged in Python then, here as well as where this is restored: both go on alike."""
    return msgspec.msgpack.encode(Snapshot(FORMAT, msgspec.Raw(encode(pipeline.memory))))


def follow(pipeline: PadPipeline, baseline: Baseline, mounting: Mounting) -> None:
    """From the next frame on, measure from a rest that has drifted; what is remembered stands."""
    memory = pipeline.memory
    pipeline.use(baseline, mounting)
    pipeline.recall(memory)


def restore(pipeline: PadPipeline, content: bytes) -> None:
    """From the next frame on, as if this pipeline had seen what the other did. It needs the same configuration and
    baseline. BadMemoryError where the memory is not one of such a pipeline; nothing has changed then."""
    if len(content) > LARGEST:
        raise BadMemoryError(f"{len(content)} bytes: no pipeline remembers so much")
    try:
        pipeline.recall(_read(content))
    except (msgspec.MsgspecError, KeyError, ValueError, TypeError) as error:
        raise BadMemoryError(f"the state is not one of this version: {type(error).__name__}: {error}") from error


def _read(content: bytes) -> PipelineMemory:
    values = msgspec.msgpack.decode(content)
    if isinstance(values, dict) and "format" not in values:
        return convert(snapshot_v1.converted(values), PipelineMemory)
    told = msgspec.msgpack.decode(content, type=Snapshot)
    if told.format != FORMAT:
        raise ValueError(f"format {told.format}, and this version knows 1 and {FORMAT}: update fmfts")
    return decode(told.memory, PipelineMemory)
