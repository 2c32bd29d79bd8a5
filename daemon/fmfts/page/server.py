"""`fmfts-daemon view`: serves the page, and brings the bus to it."""

from __future__ import annotations

import asyncio
import errno
import logging
import resource
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.http11 import Request, Response

from fmfts.page.commands import Commands
from fmfts.page.connection import BATCH_S, PageConnection
from fmfts.page.feed import Feed
from fmfts.page.files import Files
from fmfts.page.guard import Guard, RefusedAddressError
from fmfts.page.recordings import Recordings
from fmfts_client import Endpoints

SOCKET_PATH = "/socket"
OPEN_PAGES = 32
# Connections that have not said yet what they want. The oldest is dropped for a new one: who opens a thousand and says
# nothing keeps nobody out.
WAITING = 128
LARGEST_REQUEST = 16 * 1024
HANDSHAKE_S = 5.0
log = logging.getLogger(__name__)


class PageServer:
    """Serves pages at `guard`'s host. Use `run`."""

    def __init__(self, guard: Guard, endpoints: Endpoints, recordings: Recordings, beside: Sequence[str] = ()) -> None:
        self._guard = guard
        self._tls = guard.tls()
        self._feed = Feed(endpoints, beside)
        self._commands = Commands(endpoints, recordings)
        self._pages: set[PageConnection] = set()
        self._waiting: dict[ServerConnection, None] = {}  # in the order of their coming
        self._files: Files
        self._hosts: frozenset[str] = frozenset()
        self._some = asyncio.Event()

    async def run(self, port: int, serving: Callable[[str], None]) -> None:
        """Serve until SIGINT, SIGTERM or SIGHUP. port 0: any that is free. serving: called once with the address.

        Raises RefusedAddressError if the port is taken, or may not be used.
        """
        _allow_many_descriptors()
        for name in ("websockets.server", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what strangers send is no event of ours
        over = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) != signal.SIG_IGN:
                asyncio.get_running_loop().add_signal_handler(number, over.set)
        server = await self._bound(port)
        port = next(iter(server.sockets)).getsockname()[1]
        self._hosts = self._guard.hosts(port)
        self._files = Files(self._guard.address(port).partition("/#")[0].replace("http", "ws", 1) + SOCKET_PATH)
        feeding = asyncio.create_task(self._feed_pages())
        serving(self._guard.address(port))
        try:
            await over.wait()
        finally:
            feeding.cancel()
            server.close()
            await server.wait_closed()
            await asyncio.to_thread(self._commands.recordings.close)
            self._feed.close()

    async def _bound(self, port: int) -> Server:
        outer = self

        class Counted(ServerConnection):
            def connection_made(self, transport: Any) -> None:
                super().connection_made(transport)
                outer._came(self)

            def connection_lost(self, error: Exception | None) -> None:
                outer._waiting.pop(self, None)
                super().connection_lost(error)

        try:
            return await serve(
                self._serve_page, self._guard.host, port,
                process_request=self._answer, create_connection=Counted, ssl=self._tls,
                compression=None, server_header=None, max_size=LARGEST_REQUEST, max_queue=8, open_timeout=HANDSHAKE_S,
                ping_interval=20, ping_timeout=20, close_timeout=2, backlog=256,
            )  # fmt: skip
        except OSError as error:
            why = "another program serves there" if error.errno == errno.EADDRINUSE else error.strerror
            raise RefusedAddressError(f"{self._guard.host} port {port}: {why}: choose another with --port") from error

    def _came(self, connection: ServerConnection) -> None:
        self._waiting[connection] = None
        if len(self._waiting) > WAITING:
            oldest = next(iter(self._waiting))
            del self._waiting[oldest]
            oldest.transport.abort()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file; None for our own page's connection; else a refusal."""
        self._waiting.pop(connection, None)
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return self._files.refuse(421, "Misdirected Request", "this server has another name\n")
        if request.path != SOCKET_PATH:
            return self._files.answer(request.path)
        origins = request.headers.get_all("Origin")
        if len(origins) != 1 or origins[0].lower() != f"{self._guard.scheme}://{hosts[0].lower()}":
            return self._files.refuse(403, "Forbidden", "only this server's own page may connect\n")
        if len(self._pages) >= OPEN_PAGES:
            return self._files.refuse(503, "Service Unavailable", f"{OPEN_PAGES} pages are open already\n")
        return None

    async def _serve_page(self, socket: ServerConnection) -> None:
        page = PageConnection(socket, self._feed, self._commands)
        self._pages.add(page)
        self._some.set()
        try:
            await page.serve(self._guard)
        finally:
            self._pages.discard(page)

    async def _feed_pages(self) -> None:
        """Brings what has arrived on the bus to the open pages; sleeps while there is none."""
        while True:
            if not self._pages:
                self._some.clear()
                await self._some.wait()
            self._feed.drain()
            for page in self._pages:
                page.wake()
            await asyncio.sleep(BATCH_S)


def _allow_many_descriptors() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 4096 if hard == resource.RLIM_INFINITY else min(hard, 4096)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def serve_page(
    guard: Guard,
    endpoints: Endpoints,
    folder: Path,
    base: str | None,
    port: int,
    serving: Callable[[str], None],
    beside: Sequence[str] = (),
) -> None:
    """Serve the page until a signal ends it. folder: of recordings. base: as in FMFTS_BUS, for the recorder.

    beside: see `Feed`.
    """

    async def run() -> None:
        await PageServer(guard, endpoints, Recordings(folder, base), beside).run(port, serving)

    asyncio.run(run())
