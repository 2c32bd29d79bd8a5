"""A pad's fixed texts in its messages."""

from __future__ import annotations

import math
from typing import NamedTuple

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.contact import ContactModel, NoContactModel
from fmfts.pad import Pad
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.sensor.chips import Chip
from fmfts.sensor.missing import saturated_at, untellable_by
from fmfts_client.fields import SCHEMA_VERSION

NO_BASELINE = (
    "no baseline: `fmfts-daemon baseline --bare` before the pad is mounted, then `--rest` while nothing touches it"
)
BARE_ONLY = "rest not recorded: mount the pad, then `fmfts-daemon baseline --rest` while nothing touches it"

# Deviations of the drift of one axis (tests/unit/test_warming_offsets.py): the pose explains most of such a drift.
HIDDEN_DEVIATIONS = 8.0


class Words(NamedTuple):
    """fmfts_words of frame.h. chip: by gain code what follows a saturated axis, and the same of an impossible count."""

    version: int
    pad: str
    boot: str
    model: str
    baseline: str | None
    no_model: str
    no_baseline: str
    lifted: str
    chip: tuple[tuple[str, ...], str]


def chip_words(chip: Chip) -> tuple[tuple[str, ...], str]:
    """As Words has them."""
    return tuple(saturated_at(chip, code) for code in range(len(chip.step_t))), untellable_by(chip)


def words_of(
    pad: Pad, boot: str, model: ContactModel | NoContactModel, baselined: BaselinedPad | None, why_none: str
) -> Words:
    """why_none: the reason of messages without a baseline."""
    return Words(
        version=SCHEMA_VERSION,
        pad=pad.name,
        boot=boot,
        model=model.hash,
        baseline=None if baselined is None else baselined.baseline.id,
        no_model=model.reason if isinstance(model, NoContactModel) else "",
        no_baseline=why_none if baselined is None else BARE_ONLY,
        lifted="" if baselined is None else baselined.lifted_reason,
        chip=chip_words(pad.chip),
    )


def further_drift_of(t_per_k: float, further_t2_per_k2: float, warmed_k: float) -> str:
    """What the status says of offsets that drift further than the chip's t_per_k: further_drift.c. Else empty."""
    if not further_t2_per_k2:
        return ""
    times = round(float(root_of_squares(t_per_k, math.sqrt(further_t2_per_k2))) / t_per_k)
    hidden_ut = 1e6 * HIDDEN_DEVIATIONS * times * t_per_k * abs(warmed_k)
    warmer = "warmer" if warmed_k > 0.0 else "colder"
    return (
        f"the pad is {abs(warmed_k):.0f} K {warmer} than at its baseline, and the chips' offsets seem to drift {times} "
        "times as far as their figure says. Deviations include it, but a faulty sensor that is off by up to "
        f"{hidden_ut:.1g} µT may stay unnamed. Record `fmfts-daemon baseline --rest` at this temperature"
    )
