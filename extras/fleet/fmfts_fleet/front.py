"""The page at the front of a fleet's server: its files, its open pages, and the messages to them."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path

from websockets.asyncio.server import ServerConnection

from fmfts_fleet.connection import FleetConnection
from fmfts_fleet.robots import Fleet

FOLDER = Path(__file__).parent / "static"
LOOK_S, TELL_S = 0.05, 0.5  # longest wait at the fleet, and between two reports while nobody connects or leaves


class FleetFront:
    """A `FrontPage` of fmfts_page.server."""

    folder, page = FOLDER, "fleet.html"

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._pages: set[FleetConnection] = set()

    @property
    def open_pages(self) -> int:
        return len(self._pages)

    async def serve(self, socket: ServerConnection) -> None:
        page = FleetConnection(socket)
        self._pages.add(page)
        try:
            await page.serve()
        finally:
            self._pages.discard(page)

    async def run(self) -> None:
        """Polls the fleet with or without an open page, so that a page opened later knows since when a robot is
        lost."""
        told_s = 0.0
        while True:
            now_s = time.monotonic()
            if self._fleet.look(now_s) or now_s - told_s >= TELL_S:
                told_s = now_s
                facts = json.dumps(self._fleet.facts(now_s)) if self._pages else ""
                for page in self._pages:
                    page.tell(facts)
            await asyncio.sleep(LOOK_S)

    def close(self) -> None:
        self._fleet.close()
