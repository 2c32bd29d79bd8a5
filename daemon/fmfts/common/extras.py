"""Other packages of this project: their parts, by entry points, and how to install a missing one."""

from __future__ import annotations

import sys
from typing import Any

LABORATORY = "lab"
IN_CHECKOUT = "./clients/python ."


def entry_points_of(group: str) -> Any:
    """Looking for packages takes some milliseconds."""
    from importlib.metadata import entry_points

    return entry_points(group=group)


def added(group: str, name: str) -> Any:
    """A package's part of this name; None if it is not installed."""
    return next((point.load() for point in entry_points_of(group) if point.name == name), None)


def how_to_install(package: str) -> str:
    """The end of a sentence about a package's part."""
    pip = f"{sys.executable} -m pip install"
    if package == LABORATORY:
        return f"belongs to the laboratory; install it in a checkout of fmfts with\n    {pip} {IN_CHECKOUT} ./lab"
    return (
        f"belongs to a package of its own; install it with\n    {pip} 'fmfts[{package}]'\n"
        f"or in a checkout of fmfts with\n    {pip} {IN_CHECKOUT} ./extras/{package}"
    )
