"""Starts the server of the page: for one robot, or for a fleet. Each serves until a signal ends it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fmfts.page.commands import Commands
from fmfts.page.feed import Feed
from fmfts.page.fleet import Fleet
from fmfts.page.guard import Guard
from fmfts.page.recordings import Recordings
from fmfts.page.server import FRONT, PageServer, RobotView, place_of
from fmfts_client import Endpoints


@dataclass(frozen=True)
class Where:
    """How a robot's daemon is reached. base: as in FMFTS_BUS, for the recorder; None: the default."""

    endpoints: Endpoints
    base: str | None


def serve_page(
    guard: Guard, where: Where, folder: Path, port: int, serving: Callable[[str], None], beside: Sequence[str] = ()
) -> None:
    """Serve the page of one robot. folder: of recordings. serving: called once with the address. beside: see `Feed`."""

    async def run() -> None:
        view = RobotView(Feed(where.endpoints, beside), _commands(where, folder))
        await PageServer(guard, {FRONT: view}).run(port, serving)

    asyncio.run(run())


def serve_fleet(
    guard: Guard, robots: Mapping[str, Where], folder: Path, port: int, serving: Callable[[str], None]
) -> None:
    """Serve the page of the fleet, and the page of each robot below it. Recordings' names begin with the robot's."""

    async def run() -> None:
        fleet = Fleet({name: where.endpoints for name, where in robots.items()}, time.monotonic())
        views = {
            place_of(name): RobotView(Feed(where.endpoints), _commands(where, folder, name))
            for name, where in robots.items()
        }
        await PageServer(guard, views, fleet).run(port, serving)

    asyncio.run(run())


def _commands(where: Where, folder: Path, robot: str = "fmfts") -> Commands:
    return Commands(where.endpoints, Recordings(folder, where.base, where.endpoints.key, robot))
