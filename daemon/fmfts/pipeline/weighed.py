"""The contact model of a pad whose silicone was weighed (weighing.py)."""

from __future__ import annotations

import logging

from fmfts.baseline import Baseline
from fmfts.contact import ContactModel, NoContactModel

log = logging.getLogger(__name__)


def on_weighed_silicone(model: ContactModel | NoContactModel, baseline: Baseline) -> ContactModel | NoContactModel:
    """The model with the baseline's stiffness; unchanged if the baseline has none, or another model's."""
    silicone = baseline.silicone
    if silicone is None or not isinstance(model, ContactModel):
        return model
    if silicone.model != model.hash:
        log.warning(
            "pad '%s': its silicone was weighed with another contact model, and that is not used: weigh it again",
            baseline.pad,
        )
        return model
    return model.on_silicone(silicone.stiffness, silicone.deviation)
