"""One open page of the fleet: sends it the state of all robots. It may ask for nothing else."""

from __future__ import annotations

import asyncio
import json

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from fmfts_page.commands import Ping, Watch, decode
from fmfts_page.connection import sending


class FleetConnection:
    """Serves one page until it goes. State that a page has not taken yet is replaced by newer state."""

    def __init__(self, socket: ServerConnection) -> None:
        self._socket = socket
        self._newest = ""
        self._answer: dict[str, object] | None = None
        self._ready = asyncio.Event()

    def tell(self, facts: str) -> None:
        """The fleet as it is now, as JSON."""
        self._newest = facts
        self._ready.set()

    async def serve(self) -> None:
        sender = asyncio.create_task(sending(self._socket, self._send))
        try:
            async for text in self._socket:
                self._take(text)
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()

    def _take(self, text: str | bytes) -> None:
        try:
            asked = decode(text)
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            self._answer = {"error": f"this request is none: {error}"}
        else:
            match asked:
                case Ping(sent_ms=sent_ms):
                    self._answer = {"pong": sent_ms, "now_ns": None}
                case Watch():  # names the pad in a robot's own view
                    return
                case _:
                    self._answer = {"id": asked.id, "error": "this page only shows: open the robot's own view for it"}
        self._ready.set()

    async def _send(self) -> None:
        while True:
            await self._ready.wait()
            self._ready.clear()
            answer, self._answer = self._answer, None
            newest, self._newest = self._newest, ""
            if answer is not None:
                await self._socket.send(json.dumps(answer))
            if newest:
                await self._socket.send(newest)
