"""The number of examples for a property."""

from __future__ import annotations

from hypothesis import settings


def examples(count: int) -> settings:
    """This many, and a tenth of them on emulated machines: in proportion to the profile's hundred or ten."""
    return settings(max_examples=count * settings().max_examples // 100)
