"""The contact model that a pad's configuration asks for."""

from __future__ import annotations

from fmfts.config import PadConfig
from fmfts.contact import ContactModel


def model_of(config: PadConfig, path: str | None = None) -> ContactModel:
    """path: of another model than the configuration's. ModelError where it is not of that pad."""
    contact = config.contact
    return ContactModel.load(
        contact.model if path is None else path,
        config.pad(),
        refine=contact.refine,
        friction=contact.friction,
        smoothing_s=contact.smoothing_ms * 1e-3,
    )
