"""How many examples a property is tried on."""

from __future__ import annotations

from hypothesis import settings


def examples(count: int) -> settings:
    """So many, and a tenth of them on emulated machines: in proportion to the profile's hundred or ten."""
    return settings(max_examples=count * settings().max_examples // 100)
