"""The benefit of each part of the filter behind `now`: the same motions without it, side by side."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fmfts.contact import drive
from fmfts.pipeline import parameters

# Name of a variant → (module, constant, value) that it changes.
VARIANTS: dict[str, tuple[tuple[Any, str, Any], ...]] = {
    "as it ships": (),
    "without STILL": ((parameters, "MODE_WEIGHTS", (0.0, 1.0)),),
    "force drive / 4": ((drive, "FORCE_DRIVE_N2_PER_S3", 5e4),),
    "force drive × 4": ((drive, "FORCE_DRIVE_N2_PER_S3", 8e5),),
    "place drive / 10": ((drive, "PLACE_DRIVE_MM2_PER_S3", 3e5),),
}


@contextmanager
def changed(variant: str) -> Iterator[None]:
    """The constants of a variant, for pipelines that are made meanwhile."""
    before = [(module, name, getattr(module, name)) for module, name, _ in VARIANTS[variant]]
    try:
        for module, name, value in VARIANTS[variant]:
            setattr(module, name, value)
        yield
    finally:
        for module, name, value in before:
            setattr(module, name, value)
