"""Starts the server of a robot's page, which serves until a signal ends it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fmfts_client import Endpoints
from fmfts_page.commands import Commands
from fmfts_page.feed import Feed
from fmfts_page.guard import Guard
from fmfts_page.recordings import Recordings
from fmfts_page.server import FRONT, PageServer, RobotView


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
        await PageServer(guard, {FRONT: view_of(where, folder, beside=beside)}).run(port, serving)

    asyncio.run(run())


def view_of(where: Where, folder: Path, robot: str = "fmfts", beside: Sequence[str] = ()) -> RobotView:
    """The common part of a robot's pages. robot: the beginning of its recordings' names."""
    recordings = Recordings(folder, where.base, where.endpoints.key, robot)
    return RobotView(Feed(where.endpoints, beside), Commands(where.endpoints, recordings))
