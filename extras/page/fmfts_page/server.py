"""`fmfts-daemon view`: serves the page of one robot, or of several below a front page, and brings it the buses."""

from __future__ import annotations

import asyncio
import errno
import logging
import resource
import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.http11 import Request, Response

from fmfts_page.commands import Commands
from fmfts_page.connection import BATCH_S, TOO_MANY, PageConnection, let_in
from fmfts_page.feed import Feed
from fmfts_page.files import FOLDER, SOCKET, Files
from fmfts_page.guard import Guard, RefusedAddressError
from fmfts_page.strangers import ACCEPTED_IN_A_TURN, QUEUE, Door, Strangers, doors_of

FRONT = "/"
OPEN_PAGES = 32  # that have shown the token
LARGEST_REQUEST = 16 * 1024
HANDSHAKE_S = 5.0
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RobotView:
    """The common part of the open pages of one robot."""

    feed: Feed
    commands: Commands
    pages: set[PageConnection] = field(default_factory=set)


class FrontPage(Protocol):
    """The page at FRONT if it is not a robot's own: from another package, such as the fleet's."""

    folder: Path  # folder of its files, beside those of a robot's page
    page: str  # which of them it is

    @property
    def open_pages(self) -> int:
        """How many are served."""

    async def serve(self, socket: ServerConnection) -> None:
        """Serve an open page, which has shown the token, until it goes."""

    async def run(self) -> None:
        """Feed the open pages as long as the server runs."""

    def close(self) -> None:
        """Called once, when the server has ended."""


class PageServer:
    """Serves pages at `guard`'s host. Use `run`.

    views: by place: FRONT of the only robot, or places below it, where `front` is at FRONT.
    """

    def __init__(self, guard: Guard, views: Mapping[str, RobotView], front: FrontPage | None = None) -> None:
        self._guard = guard
        self._tls = guard.tls()
        self._views = dict(views)
        self._front = front
        self._sockets = {f"{place}{SOCKET}" for place in (*views, FRONT)}
        self._strangers = Strangers()
        self._files: Files
        self._hosts: frozenset[str] = frozenset()
        self._some = asyncio.Event()

    async def run(self, port: int, serving: Callable[[str], None]) -> None:
        """Serve until SIGINT, SIGTERM or SIGHUP. port 0: any that is free. serving: called once with the address.

        Raises RefusedAddressError if the port is taken, or may not be used; and the error of what feeds the pages.
        """
        _allow_many_descriptors()
        for name in ("websockets.server", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # malformed input of strangers is not logged
        over = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) != signal.SIG_IGN:
                asyncio.get_running_loop().add_signal_handler(number, over.set)
        try:
            doors = doors_of(self._guard.host, port, self._strangers)
        except OSError as error:
            why = "another program serves there" if error.errno == errno.EADDRINUSE else error.strerror
            raise RefusedAddressError(f"{self._guard.host} port {port}: {why}: choose another with --port") from error
        port = doors[0].getsockname()[1]
        servers = [await self._served(door) for door in doors]
        self._hosts = self._guard.hosts(port)
        self._files = self._all_files(self._guard.address(port).partition("/#")[0].replace("http", "ws", 1))
        feeding: list[asyncio.Task[Any]] = [asyncio.create_task(over.wait()), asyncio.create_task(self._feed_pages())]
        if self._front is not None:
            feeding.append(asyncio.create_task(self._front.run()))
        serving(self._guard.address(port))
        try:
            await _first_over(feeding)
        finally:
            for task in feeding:
                task.cancel()
            for server in servers:
                server.close()
                await server.wait_closed()
            for view in self._views.values():
                await asyncio.to_thread(view.commands.recordings.close)
                view.feed.close()
            if self._front is not None:
                self._front.close()

    def _all_files(self, server: str) -> Files:
        pages = dict.fromkeys(self._views, "index.html")
        if self._front is None:
            return Files(server, pages)
        return Files(server, {FRONT: self._front.page} | pages, (FOLDER, self._front.folder))

    async def _served(self, door: Door) -> Server:
        strangers = self._strangers

        class Counted(ServerConnection):
            def connection_made(self, transport: Any) -> None:
                strangers.speaks(transport)
                super().connection_made(transport)

            def connection_lost(self, error: Exception | None) -> None:
                strangers.left(self.transport)
                super().connection_lost(error)

        server = await serve(
            self._serve_page, sock=door,
            process_request=self._answer, create_connection=Counted, ssl=self._tls,
            compression=None, server_header=None, max_size=LARGEST_REQUEST, max_queue=8, open_timeout=HANDSHAKE_S,
            ping_interval=20, ping_timeout=20, close_timeout=2, backlog=ACCEPTED_IN_A_TURN,
        )  # fmt: skip
        door.listen(QUEUE)  # asyncio takes one number for both
        return server

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file; None for our own page's connection; else a refusal."""
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return self._files.refuse(421, "Misdirected Request", "this server has another name\n")
        if request.path not in self._sockets:
            return self._files.answer(request.path)
        origins = request.headers.get_all("Origin")
        if len(origins) != 1 or origins[0].lower() != f"{self._guard.scheme}://{hosts[0].lower()}":
            return self._files.refuse(403, "Forbidden", "only this server's own page may connect\n")
        return None

    async def _serve_page(self, socket: ServerConnection) -> None:
        if not await let_in(socket, self._guard):
            return
        self._strangers.left(socket.transport)
        open_pages = sum(len(view.pages) for view in self._views.values())
        if open_pages + (self._front.open_pages if self._front is not None else 0) >= OPEN_PAGES:
            await socket.close(TOO_MANY, f"{OPEN_PAGES} pages are open already: close one")
            return
        assert socket.request is not None
        view = self._views.get(socket.request.path.removesuffix(SOCKET))
        if view is not None:
            await self._serve_robot(socket, view)
        elif self._front is not None:
            await self._front.serve(socket)

    async def _serve_robot(self, socket: ServerConnection, view: RobotView) -> None:
        page = PageConnection(socket, view.feed, view.commands)
        view.pages.add(page)
        self._some.set()
        try:
            await page.serve()
        finally:
            view.pages.discard(page)

    async def _feed_pages(self) -> None:
        """Passes messages of the buses to the open pages; sleeps while there is no page."""
        while True:
            looked_at = [view for view in self._views.values() if view.pages]
            if not looked_at:
                self._some.clear()
                await self._some.wait()
            for view in looked_at:
                view.feed.drain()
                for page in view.pages:
                    page.wake()
            await asyncio.sleep(BATCH_S)


async def _first_over(tasks: list[asyncio.Task[Any]]) -> None:
    """Wait until one of them ends. Its error is logged and raised, because otherwise all pages would silently stop."""
    ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in ended:
        try:
            task.result()
        except Exception:
            log.exception("internal error, worth reporting: no page shows anything new, so the server ends")
            raise


def _allow_many_descriptors() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 4096 if hard == resource.RLIM_INFINITY else min(hard, 4096)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
