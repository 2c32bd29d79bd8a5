"""Kinds of contact models that other packages add, by the suffix of their files. Their pads' magnets may be unknown."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from fmfts.common.extras import PartError, added, how_to_install
from fmfts.config.section import Problem
from fmfts.contact.plugged import PluggedModel

if TYPE_CHECKING:
    from fmfts.config import PadConfig

MODELS = "fmfts.contact_models"  # entry points: objects like ModelKind, by the suffix without its point
# The extra that reads such files, where no package here does.
OF_SUFFIX = {".response": "skin", ".force": "skin"}


class ModelKind(Protocol):
    """How another package judges a pad's configuration, reads its contact model, and makes its pipeline."""

    def problems(self, pad: PadConfig) -> Iterator[Problem]:
        """Configured functions that such a pad lacks."""

    def load(self, path: Path, sensors: int) -> PluggedModel:
        """ModelError if it cannot serve a pad with this many sensors."""

    def pipeline(self, config: PadConfig, model: Any, boot: str) -> Any:
        """A PluggedPipeline (pipeline/plugged.py), still without a baseline."""


def kind_of(model: str) -> ModelKind | None:
    """The kind of the file that `[pad.contact] model` names; None: a kind of this package. PartError."""
    return _added(Path(model).suffix[1:])


@cache
def _added(suffix: str) -> ModelKind | None:
    try:
        kind: ModelKind | None = added(MODELS, suffix) if suffix else None
    except PartError as error:
        extra = OF_SUFFIX.get(f".{suffix}")
        how = f"; it {how_to_install(extra)}" if extra else ""
        raise PartError(f"contact models '.{suffix}': {error}{how}") from error
    return kind


def lacking(model: str) -> str | None:
    """The package to install for such a file, as the end of a sentence; None: it needs no other package. PartError."""
    extra = OF_SUFFIX.get(Path(model).suffix)
    return None if extra is None or kind_of(model) is not None else how_to_install(extra)
