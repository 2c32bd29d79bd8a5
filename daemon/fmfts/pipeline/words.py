"""A pad's fixed texts in its messages."""

from __future__ import annotations

from typing import NamedTuple

from fmfts.contact import ContactModel, NoContactModel
from fmfts.pad import Pad
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.sensor.missing import saturated_at, untellable_by
from fmfts_client.fields import SCHEMA_VERSION

NO_BASELINE = "no baseline: record one with `fmfts-daemon baseline` while nothing touches the pad"
BARE_ONLY = "rest not recorded: mount the pad, then `fmfts-daemon baseline --rest` while nothing touches it"


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
        chip=(tuple(saturated_at(pad.chip, code) for code in range(len(pad.chip.step_t))), untellable_by(pad.chip)),
    )
