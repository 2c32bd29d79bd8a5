"""Answers about all pads that are encoded once, however often peers ask."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import msgspec

from fmfts.bus.encoding import encoded


class KeptAnswer:
    """The facts of all pads, encoded. A pad is encoded again when its `key_of` changes.

    facts_of: the facts of the pad of this name, or a message. key_of: the part of them that may change; it must be
    cheap, because each new answer computes it for all pads. Without it, the facts are compared.
    """

    def __init__(
        self,
        names: Callable[[], Iterable[str]],
        facts_of: Callable[[str], Any],
        key_of: Callable[[str], Any] | None = None,
    ) -> None:
        self._names = names
        self._facts_of = facts_of
        self._key_of = key_of or facts_of
        self._pads: dict[str, tuple[Any, msgspec.Raw]] = {}
        self._whole: msgspec.Raw | None = None

    def forget(self) -> None:
        """The facts may have changed."""
        self._whole = None

    def whole(self) -> msgspec.Raw:
        """All pads, the same until `forget`. Raises NotFiniteError."""
        if self._whole is None:
            self._whole = encoded([self._pad(name) for name in self._names()])
        return self._whole

    def _pad(self, name: str) -> msgspec.Raw:
        key = self._key_of(name)
        if name not in self._pads or self._pads[name][0] != key:
            self._pads[name] = key, encoded(self._facts_of(name))
        return self._pads[name][1]
