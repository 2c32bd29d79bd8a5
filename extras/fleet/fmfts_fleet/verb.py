"""`fmfts-daemon view --robot NAME=ENDPOINT …`: one page for several robots."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.cli.verb import VerbError
from fmfts.common import exit_codes

if TYPE_CHECKING:
    from fmfts_page.guard import Guard
    from fmfts_page.serving import Where

ROBOT_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
OF_ONE_ROBOT = ("config", "fixed_baseline", "ghost_endpoint", "beside", "foxglove")


def view_fleet(options: argparse.Namespace, guard: Guard, port: int, serving: Callable[[str], None]) -> None:
    """Serve the fleet's page. Raises VerbError, EndpointError, and RefusedAddressError where the port is taken."""
    from fmfts_fleet.serving import serve_fleet

    given = [name for name in OF_ONE_ROBOT if getattr(options, name)]
    if given:
        raise VerbError(exit_codes.USAGE, f"--{given[0].replace('_', '-')} is for one robot: leave it out with --robot")
    robots: dict[str, Where] = {}
    for word in options.robot:
        name, where = _robot(word, options.robot_keys)
        if name in robots:
            raise VerbError(exit_codes.USAGE, f"--robot {word}: there is a robot '{name}' already")
        robots[name] = where
    serve_fleet(guard, robots, options.recordings.absolute(), port, serving)


def _robot(word: str, keys: Path | None) -> tuple[str, Where]:
    """The robot that NAME=ENDPOINT names. Raises VerbError, or EndpointError."""
    from fmfts_client import BadKeyError, EndpointError
    from fmfts_client.endpoints import for_client
    from fmfts_page.serving import Where

    name, _, base = word.partition("=")
    if not ROBOT_NAME.fullmatch(name) or not base:
        raise VerbError(
            exit_codes.USAGE,
            f"--robot {word}: give NAME=ENDPOINT, such as arm=tcp://192.168.1.21:5570; a name is 1 to 32 letters "
            "without accents, digits, - or _",
        )
    try:
        endpoints = for_client(base)
    except EndpointError as error:
        raise EndpointError(f"--robot {word}: {error}") from error
    key = keys / f"{name}.key" if keys is not None and base.startswith("tcp://") else None
    if key is not None and not key.exists():
        raise BadKeyError(
            f"--robot {word}: there is no {key}: make it on that robot with "
            f"`fmfts-daemon keys new CLIENT -o {name}.key`, and copy it here by a safe way"
        )
    return name, Where(replace(endpoints, key=key), base)
