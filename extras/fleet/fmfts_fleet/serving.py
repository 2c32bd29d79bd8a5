"""Serves the page of a fleet, and the page of each robot below it, until a signal ends it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from fmfts_fleet.front import FleetFront
from fmfts_fleet.robots import Fleet
from fmfts_page.guard import Guard
from fmfts_page.server import PageServer
from fmfts_page.serving import Where, view_of


def place_of(robot: str) -> str:
    """Where the server of a fleet has this robot's own view."""
    return f"/robot/{robot}/"


def serve_fleet(
    guard: Guard, robots: Mapping[str, Where], folder: Path, port: int, serving: Callable[[str], None]
) -> None:
    """folder: of recordings, whose names begin with the robot's. serving: called once with the address."""

    async def run() -> None:
        fleet = Fleet({name: where.endpoints for name, where in robots.items()}, time.monotonic())
        views = {place_of(name): view_of(where, folder, name) for name, where in robots.items()}
        await PageServer(guard, views, FleetFront(fleet)).run(port, serving)

    asyncio.run(run())
