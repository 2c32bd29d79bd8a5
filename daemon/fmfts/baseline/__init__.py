"""The baseline: the field of an unloaded pad. It is recorded, checked, stored, and subtracted from every frame."""

from fmfts.baseline.accuracy import accuracy
from fmfts.baseline.baseline import Baseline, encode, load, make_bare, make_refined, make_rest, make_turn
from fmfts.baseline.drift import DriftFollower, Quiet
from fmfts.baseline.mounting import Mounting, estimate_mounting
from fmfts.baseline.recording import BaselineError, Recording, summarise
from fmfts.baseline.window_means import Means, means, turning_means

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
    "turning_means",
]
