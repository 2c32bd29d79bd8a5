"""What each part of the filter behind `now` brings: the same motions without it, side by side."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fmfts.contact import drive
from fmfts.contact import now as carrying
from fmfts.pipeline.fast import now_parameters
from fmfts.pose import motion

# Name of a variant → (module, constant, value) that it changes.
VARIANTS: dict[str, tuple[tuple[Any, str, Any], ...]] = {
    "as it ships": (),
    "without STILL": ((motion, "WEIGHTS", (0.0, 1.0)),),
    "modes 3 × as lasting": ((motion, "SWITCHES_PER_S", 10.0),),
    "modes 1/3 as lasting": ((motion, "SWITCHES_PER_S", 90.0),),
    "lasting errors in full": ((motion, "LASTING_SHARE", 1.0),),
    "no lasting errors": ((motion, "LASTING_SHARE", 0.0),),
    "force drive / 4": tuple((one, "FORCE_DRIVE_N2_PER_S3", 5e4) for one in (drive, carrying, now_parameters)),
    "force drive × 4": tuple((one, "FORCE_DRIVE_N2_PER_S3", 8e5) for one in (drive, carrying, now_parameters)),
    "place drive / 10": tuple((one, "PLACE_DRIVE_MM2_PER_S3", 3e5) for one in (drive, carrying, now_parameters)),
    "none of the lead": ((carrying, "LEAD_SHARE", 0.0),),
    "all of the lead": ((carrying, "LEAD_SHARE", 1.0),),
    "rates not shrunk": tuple(
        (one, name, 1e9) for one in (carrying, now_parameters) for name in ("FORCE_RATE_N_PER_S", "PLACE_RATE_M_PER_S")
    ),
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
