"""The message of a test if the system lacks a requirement."""

from __future__ import annotations

import importlib
import os

import pytest


def missing(what: str) -> None:
    """Skip a test whose package is absent, by name; on CI that is a failure."""
    if os.environ.get("CI"):
        pytest.fail(f"{what} is missing, and CI installs everything", pytrace=False)
    pytest.skip(f"{what} is missing")


def package_is_absent(name: str) -> bool:
    try:
        importlib.import_module(name)
    except ImportError:
        return True
    return False
