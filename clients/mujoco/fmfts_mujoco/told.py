"""Messages of a pad that were published in the simulation, decoded when somebody looks at them."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from typing import overload

import msgpack  # type: ignore[import-untyped]
from fmfts_client import Contact


class Told(Sequence[Contact]):
    """Messages in order. payloads: as the bus would carry them; published_ns: when, on the simulation's clock."""

    def __init__(self, published_ns: Sequence[int] = (), payloads: Sequence[bytes] = ()) -> None:
        self.published_ns, self.payloads = list(published_ns), list(payloads)

    def extend(self, published_ns: Iterable[int], payloads: Iterable[bytes]) -> None:
        """Later messages."""
        self.published_ns.extend(published_ns)
        self.payloads.extend(payloads)

    def split(self, now_ns: int) -> tuple[Told, Told]:
        """Messages that are published by now, and later ones."""
        published = bisect_right(self.published_ns, now_ns)
        if published == len(self.payloads):
            return self, Told()
        before, after = slice(None, published), slice(published, None)
        return (
            Told(self.published_ns[before], self.payloads[before]),
            Told(self.published_ns[after], self.payloads[after]),
        )

    def __len__(self) -> int:
        return len(self.payloads)

    @overload
    def __getitem__(self, index: int) -> Contact: ...

    @overload
    def __getitem__(self, index: slice) -> Told: ...

    def __getitem__(self, index: int | slice) -> Contact | Told:
        if isinstance(index, slice):
            return Told(self.published_ns[index], self.payloads[index])
        body = msgpack.unpackb(self.payloads[index])
        body["t_publish_ns"] = body["utc_ns"] = self.published_ns[index]
        return Contact.from_message(body)
