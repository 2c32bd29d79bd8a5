"""The magnets of other pads in the problem that `pose` solves, where they may move: `pose --neighbours`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from fmfts.config import PadConfig, neighbours_of
from fmfts.pad import Array, Magnet, SensorArray
from fmfts.pose.neighbour import NeighbourEstimate, NeighbourView
from fmfts.pose.problem import Part, Parts, Prior
from fmfts.pose.sighting import COLUMNS, Sighting, where_of
from fmfts.pose.state import SIZE, State


def neighbours_at_rest(pad: PadConfig, pads: Sequence[PadConfig]) -> list[NeighbourEstimate]:
    """The neighbours that `pad` names, with the uncertainty of magnets that no pad has observed yet."""
    views = []
    for other in neighbours_of(pad, pads):
        placement = other.placement.si().seen_from(pad.placement.si())
        views.append(NeighbourView(Sighting.unseen(other.pad()), placement).at(0))
    return views


def with_rest(field_t: Array, sensors: SensorArray, seen: Sequence[NeighbourEstimate]) -> Array:
    """Add the field of the neighbours at rest, which the baseline subtracted, to the field (N, 3) T again."""
    return field_t + sum(other.effect(sensors)[0] for other in seen)


def joined(start: State, parts: Parts, prior: Prior, seen: Sequence[NeighbourEstimate]) -> tuple[State, Parts, Prior]:
    """Add the neighbours to start, parts and prior of a problem."""
    now = tuple(chain.from_iterable(where_of(other.now) for other in seen))
    columns = SIZE + COLUMNS * len(now)
    covariance = np.zeros((columns, columns))
    covariance[:SIZE, :SIZE] = prior.covariance
    first = SIZE
    for other in seen:
        own = slice(first, first + len(other.covariance))
        covariance[own, own], first = other.covariance, own.stop
    others = np.full(COLUMNS * len(now), Part.PRIOR, dtype=parts.dtype)
    return (
        replace(start, neighbours=now),
        np.concatenate([parts, others]),
        Prior(replace(prior.mean, neighbours=now), covariance),
    )


def their_magnets(seen: Sequence[NeighbourEstimate]) -> list[Magnet]:
    """The neighbours that `joined` adds, in its order."""
    return [magnet for other in seen for magnet in other.magnets]
