"""The baseline: what an unloaded pad's sensors see, recorded, checked, stored, and taken away from every frame."""

from fmfts.ambient.aligned import Means, means
from fmfts.ambient.baseline import Baseline, encode, load, make_bare, make_refined, make_rest, make_turn
from fmfts.ambient.drift import DriftFollower, Quiet
from fmfts.ambient.gained import accuracy
from fmfts.ambient.mounting import Mounting, estimate_mounting
from fmfts.ambient.recording import BaselineError, Recording, summarise

__all__ = [
    "Baseline",
    "BaselineError",
    "DriftFollower",
    "Means",
    "Mounting",
    "Quiet",
    "Recording",
    "accuracy",
    "encode",
    "estimate_mounting",
    "load",
    "make_bare",
    "make_refined",
    "make_rest",
    "make_turn",
    "means",
    "summarise",
]
