"""What a pipeline remembers of the frames before: all that the next message depends on besides its frame.

A recording that begins in the middle of a touch holds it, so that a replay goes on from there bit for bit; a baseline
that moves with a drift keeps it. All that the pipeline's own objects hold is taken, so that nobody has to keep a list
when a filter gets another state, but for what is known to follow from configuration and baseline (FOLLOWS). No pickle:
numbers, text and arrays, as msgpack.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import msgspec
import numpy as np

from fmfts.baseline import Baseline, Mounting
from fmfts.bus.messages import StateMessage
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.pad import Magnet, Pad, SensorArray
from fmfts.pipeline.baselined_pad import ZeroedPad
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pose import SOLVER, State, TrackingModel
from fmfts.pose.innovation import Finding
from fmfts.pose.state import Neighbour

VALUES = {kind.__name__: kind for kind in (State, Neighbour, Finding)}
FOLLOWS = (Pad, SensorArray, Magnet, TrackingModel, ContactModel, Baseline, Mounting, ZeroedPad)
# Of one frame alone, or made from what else is here when it is wanted.
# What follows from the mounting: it may be another than before, or made anew.
OF_THE_MOUNTING = {"_rest", "rest", "_rows", "_magnets", "_errors"}
OF_MESSAGES = {"_templates", "_templates_of", "_last_kind"}
OF_THE_RATE = {"longest_gap_s"}
PASSING = OF_THE_MOUNTING | OF_MESSAGES | OF_THE_RATE
PASSING |= {"_nearest", "_neighbours", "_path", "_compiled", "_new_warmth"}
# What memories of earlier versions lack, as it was in them.
ADDED = {"_unread_variance": 0.0}
LARGEST = 1 << 20


class BadMemoryError(ValueError):
    """A memory does not belong to this pipeline, or is damaged."""


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
    pipeline.hand_back()
    return msgspec.msgpack.encode(_taken(pipeline))


def follow(pipeline: PadPipeline, baseline: Baseline, mounting: Mounting) -> None:
    """From the next frame on, measure from a rest that has drifted; what is remembered stands."""
    memory = snapshot(pipeline)
    pipeline.use(baseline, mounting)
    restore(pipeline, memory)


def restore(pipeline: PadPipeline, memory: bytes) -> None:
    """From the next frame on, as if this pipeline had seen what the other did. It needs the same configuration and
    baseline. BadMemoryError where the memory is not one of such a pipeline; it must not be used any more then."""
    if len(memory) > LARGEST:
        raise BadMemoryError(f"{len(memory)} bytes: no pipeline remembers so much")
    try:
        _put_back(pipeline, msgspec.msgpack.decode(memory))
    except (msgspec.DecodeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise BadMemoryError(f"the state is not one of this version: {type(error).__name__}: {error}") from error


def _attributes(owner: object) -> Iterator[tuple[str, Any]]:
    """In a fixed order."""
    names = [each.name for each in fields(owner)] if is_dataclass(owner) else sorted(vars(owner))
    for name in names:
        value = getattr(owner, name)
        if name not in PASSING and not isinstance(value, FOLLOWS):
            yield name, value


def _taken(owner: object) -> dict[str, Any]:
    return {name: _encoded(value, f"{type(owner).__name__}.{name}") for name, value in _attributes(owner)}


def _encoded(value: Any, where: str) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value.item() if isinstance(value, np.generic) else value
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        return {"array": value.tobytes(), "type": value.dtype.str, "shape": value.shape}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple | list | deque | set):
        items = sorted(value) if isinstance(value, set) else value
        return {"items": [_encoded(item, where) for item in items], "kind": type(value).__name__}
    if type(value).__name__ in VALUES:
        members = {each.name: _encoded(getattr(value, each.name), where) for each in fields(value)}
        return {"value": type(value).__name__, "members": members}
    if type(value).__module__.startswith("fmfts."):
        return {"owner": _taken(value)}
    raise TypeError(f"{where} is a {type(value).__name__}: say in memory.py whether it is remembered")


def _put_back(owner: object, taken: dict[str, Any]) -> None:
    expected = {name for name, _ in _attributes(owner)}
    taken = {name: value for name, value in ADDED.items() if name in expected} | taken
    if set(taken) != expected:
        raise ValueError(f"{type(owner).__name__} has {', '.join(sorted(expected ^ set(taken)))} on one side only")
    for name, value in taken.items():
        held = getattr(owner, name)
        if isinstance(value, dict) and "owner" in value:
            _put_back(held, value["owner"])
        else:
            setattr(owner, name, _decoded(value, held))


def _decoded(value: Any, held: Any) -> Any:
    """held: what stands there now."""
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return np.frombuffer(value["array"], np.dtype(value["type"])).reshape(value["shape"]).copy()
    if "items" in value:
        items = [_decoded(item, None) for item in value["items"]]
        match value["kind"]:
            case "deque":
                return deque(items, maxlen=held.maxlen)
            case "tuple":
                return tuple(items)
            case "set":
                return set(items)
        return items
    return VALUES[value["value"]](**{name: _decoded(member, None) for name, member in value["members"].items()})
