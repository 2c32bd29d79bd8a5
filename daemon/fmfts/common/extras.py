"""Other packages of this project: their parts, by entry points, and how to install a missing one."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from shlex import quote
from typing import Any

import fmfts

LABORATORY = "lab"
# Other folders that pip needs beside it.
NEEDS = {
    "calibrate": "extras/simulation ",
    **dict.fromkeys(("skin", LABORATORY), "extras/simulation extras/calibrate "),
    **dict.fromkeys(("collect", "page", "report"), "extras/recording "),
    **dict.fromkeys(("fleet", "foxglove"), "extras/recording extras/page "),
}
CHECKOUT = Path(fmfts.__file__).parents[2]  # of an editable installation


def entry_points_of(group: str) -> Any:
    """Looking for packages takes some milliseconds."""
    from importlib.metadata import entry_points

    return entry_points(group=group)


class PartError(Exception):
    """A package's part cannot be loaded. The text says what is wrong with the package."""


def loaded(point: Any) -> Any:
    """The part at an entry point. PartError if its package lacks another, or is of another version than this one."""
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        whose = "its package" if point.dist is None else f"package {point.dist.name}"
        lacks = error.name if isinstance(error, ModuleNotFoundError) else None
        if lacks is None or lacks.startswith("fmfts"):
            raise PartError(f"{whose} does not fit this version: {error}") from error
        raise PartError(f"{whose} lacks module {lacks.partition('.')[0]}") from error  # installed with --no-deps


def added(group: str, name: str) -> Any:
    """A package's part of this name; None if it is not installed. PartError."""
    return next((loaded(point) for point in entry_points_of(group) if point.name == name), None)


def how_to_install(package: str, checkout: Path = CHECKOUT) -> str:
    """The end of a sentence about a package's part. An editable installation stays one."""
    pip = f"{quote(sys.executable)} -m pip install"
    is_laboratory = package == LABORATORY
    folders = (NEEDS.get(package, "") + ("lab" if is_laboratory else f"extras/{package}")).split()
    whose = f"belongs to {'the laboratory' if is_laboratory else 'a package of its own'}; install it"
    extra = "" if is_laboratory else f"'fmfts[{package}]' "
    if os.path.isfile(checkout / "pyproject.toml"):  # false, too, where this user may not look
        return f"{whose} with\n    {pip} {extra}{' '.join(f'-e {quote(str(checkout / folder))}' for folder in folders)}"
    this = extra.replace("fmfts", ".") or ". "
    of_folders = f"{pip} ./clients/python {this}{' '.join(f'./{folder}' for folder in folders)}"
    by_name = "" if is_laboratory else f"with\n    {pip} {extra.strip()}\nor "
    return f"{whose} {by_name}in a checkout of fmfts with\n    {of_folders}"
