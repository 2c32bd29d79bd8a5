"""Answers about all pads that are encoded once, however often peers ask."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import msgspec

from fmfts.bus.encoding import encoded


class KeptAnswer:
    """What `facts_of` says of each pad, encoded. A pad is encoded again when its facts change.

    facts_of: the facts of the pad of this name, or a message; cheap, because each new answer asks for all pads.
    """

    def __init__(self, names: Callable[[], Iterable[str]], facts_of: Callable[[str], Any]) -> None:
        self._names = names
        self._facts_of = facts_of
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
        facts = self._facts_of(name)
        if name not in self._pads or self._pads[name][0] != facts:
            self._pads[name] = facts, encoded(facts)
        return self._pads[name][1]
