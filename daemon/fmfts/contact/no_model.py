"""Replaces the contact model if none fits the pad: the pad runs, without place and force."""

from __future__ import annotations

from dataclasses import dataclass

from fmfts.contact.response import Response

NO_MODEL = "none"  # `[pad.contact] model`, and the hash in messages and recordings


@dataclass(frozen=True, slots=True)
class NoContactModel:
    """reason: the `reason` of messages whose place and force are null because of this. tells: what messages contain
    instead."""

    reason: str
    tells: str
    hash: str = NO_MODEL
    smoothing_s: float = 0.0
    response: Response | None = None

    @property
    def calibrated_range(self) -> dict[str, object]:
        return {}


def no_model_for(configured: str, magnets: int = 1) -> NoContactModel:
    """The stand-in of a pad whose `[pad.contact] model` is `configured`: "none", or a shipped one that does not fit.

    magnets: of the pad.
    """
    why = (
        f'[pad.contact] model is "{NO_MODEL}"'
        if configured == NO_MODEL
        else f'"{configured}" is for the pad of the shipped config.toml, and the magnet here has another size or place'
        if magnets == 1
        else f'"{configured}" is for the four magnets of docs/several.md, and this pad has others, or not all of them'
    )
    how = "calibrate it (docs/calibration.md)" if magnets == 1 else "make a table of its presses (docs/several.md)"
    tells = "touch, pose and displacement" if magnets == 1 else "touch, the poses of all magnets and displacement"
    return NoContactModel(f"no contact model for this pad: {why}; to get forces, {how}", tells)
