"""Reads a pad's configuration from a recording. Another version may have written it, or one with more packages."""

from __future__ import annotations

from typing import Any

import msgspec

from fmfts.common.extras import PartError
from fmfts.config import PadConfig
from fmfts.config.model_kinds import lacking
from fmfts.config.sources import lacking_source
from fmfts.config.wording import value_at


def recorded_pad(config: dict[str, Any]) -> PadConfig:
    """msgspec.ValidationError if it is none; where a package is missing, with how to install it."""
    try:
        pad = msgspec.convert(config, PadConfig)
    except msgspec.ValidationError as error:
        kind = value_at(config, ["source", "type"])
        how = lacking_source(kind)
        raise msgspec.ValidationError(str(error) if how is None else f"its source {kind!r} {how}") from error
    try:
        how = None if pad.other_magnets else lacking(pad.contact.model)
    except PartError as error:
        raise msgspec.ValidationError(str(error)) from error
    if how is not None:
        raise msgspec.ValidationError(f"its contact model {pad.contact.model} {how}")
    return pad
