"""What a test says where the system lacks what it needs."""

from __future__ import annotations

import os

import pytest


def missing(what: str) -> None:
    """Skip a test whose system package is absent, by name; on CI that is a failure."""
    if os.environ.get("CI"):
        pytest.fail(f"{what} is missing, and CI installs everything", pytrace=False)
    pytest.skip(f"{what} is missing")
