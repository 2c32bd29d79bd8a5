"""A pipeline's memory of earlier frames, as bytes. A recording starts with it, so a replay continues bit for bit.

PadMemory of remembering.py says what it holds; a pad of another package has its own.
"""

from __future__ import annotations

import time

import msgspec

from fmfts.baseline import Baseline, Mounting
from fmfts.bus.messages import StateMessage
from fmfts.common.memory import decode, encode
from fmfts.config import PadConfig
from fmfts.pipeline.configured import Pipeline
from fmfts.pipeline.pad_pipeline import PadPipeline

FORMAT = 3
LARGEST = 1 << 20


class BadMemoryError(ValueError):
    """The memory is damaged, or belongs to another pipeline."""


class Snapshot(msgspec.Struct):
    format: int
    memory: msgspec.Raw


def state_message(pipeline: Pipeline, config: PadConfig, boot: str) -> StateMessage:
    """All that a replay needs besides the frames that follow."""
    baseline = pipeline.baseline
    return StateMessage(
        pad=pipeline.pad.name,
        boot=boot,
        utc_ns=time.time_ns(),
        config=msgspec.to_builtins(config),
        model=pipeline.model_hash,
        baseline=None if baseline is None else msgspec.to_builtins(baseline),
        memory=snapshot(pipeline),
    )


def snapshot(pipeline: Pipeline) -> bytes:
    """The pipeline's memory as bytes."""
    return msgspec.msgpack.encode(Snapshot(FORMAT, msgspec.Raw(encode(pipeline.memory))))


def follow(pipeline: PadPipeline, baseline: Baseline, mounting: Mounting) -> None:
    """Use a baseline whose rest has drifted, and keep the memory of earlier frames."""
    memory = pipeline.memory
    pipeline.use(baseline, mounting)
    pipeline.recall(memory)


def restore(pipeline: Pipeline, content: bytes) -> None:
    """Continue as the pipeline whose `snapshot` this is. Configuration and baseline must be the same.

    BadMemoryError, and nothing changes, if the memory does not fit this pipeline.
    """
    if len(content) > LARGEST:
        raise BadMemoryError(f"{len(content)} bytes: more than any pipeline remembers")
    try:
        pipeline.recall(decode(_unwrapped(content), pipeline.memory_kind))
    except (msgspec.MsgspecError, KeyError, ValueError, TypeError) as error:
        raise BadMemoryError(
            f"the state is of another version of fmfts, or of another pad, or is damaged ({error}): replay the "
            "recording with the version that made it"
        ) from error


def _unwrapped(content: bytes) -> bytes:
    wrapped = msgspec.msgpack.decode(content, type=Snapshot)
    if wrapped.format != FORMAT:
        raise ValueError(f"format {wrapped.format}, but this version of fmfts reads only {FORMAT}")
    return bytes(wrapped.memory)
