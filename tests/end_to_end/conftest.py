"""Shared by tests of whole processes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from end_to_end.processes import FirmwareHost, resting_field
from fmfts.pad import Pad


@pytest.fixture
def host(tmp_path: Path, pad: Pad) -> Iterator[FirmwareHost]:
    """A board of the real firmware, whose pad nobody touches."""
    with FirmwareHost(tmp_path) as host:
        host.field(resting_field(pad))
        yield host
