"""One open page: its admission, its view, and its requests."""

from __future__ import annotations

import asyncio
import json
import logging
import threading
import time
from collections.abc import Awaitable, Callable
from itertools import islice
from pathlib import Path
from typing import Any

import msgpack  # type: ignore[import-untyped]
import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from fmfts_page.commands import ERRORS, Commands, Ping, Replay, Watch, decode
from fmfts_page.feed import Feed, Viewer
from fmfts_page.guard import Guard
from fmfts_page.recordings import messages_of, pads_of
from fmfts_recording.file import time_span_ns

HELLO_S = 5.0
REQUESTS_AT_ONCE = 4
ANSWERS_KEPT = 64  # most bytes that the page has not taken yet: beyond, its requests are not read
WRONG_TOKEN, TOO_MANY = 4401, 4429  # application's own close codes
FAILED = 1011  # the protocol's own for an internal error
BATCH_S = 0.025
AT_ONCE = 200  # messages of a recording that are read at once

log = logging.getLogger(__name__)


async def let_in(socket: ServerConnection, guard: Guard) -> bool:
    """Is the first message {"token": …}, with the right one? Else the connection is closed."""
    try:
        first = json.loads(await asyncio.wait_for(socket.recv(), HELLO_S))
    except (TimeoutError, ValueError, RecursionError, ConnectionClosed):
        first = None
    if isinstance(first, dict) and guard.knows(first.get("token")):
        return True
    await socket.close(WRONG_TOKEN, "wrong token: open the address that fmfts-daemon view printed")
    return False


async def sending(socket: ServerConnection, send: Callable[[], Awaitable[None]]) -> None:
    """Send until the page goes. An error closes the page, which then connects anew instead of standing still."""
    try:
        await send()
    except ConnectionClosed:
        pass
    except Exception:
        log.exception("internal error, worth reporting: a page is closed, and connects anew")
        await socket.close(FAILED, "internal error: the log of fmfts-daemon view shows it")


class PageConnection:
    """Serves one page until it goes."""

    def __init__(self, socket: ServerConnection, feed: Feed, commands: Commands) -> None:
        self._socket = socket
        self._feed = feed
        self._commands = commands
        self._viewer = Viewer()
        self._ready = asyncio.Event()
        self._said: list[str] = []
        self._taken = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._replay: asyncio.Task[None] | None = None

    def wake(self) -> None:
        """New messages may be there to send."""
        self._ready.set()

    async def serve(self) -> None:
        self._feed.add(self._viewer)
        sender = asyncio.create_task(sending(self._socket, self._send))
        sender.add_done_callback(lambda _: self._taken.set())
        try:
            async for text in self._socket:
                self._take(text)
                while len(self._said) >= ANSWERS_KEPT and not sender.done():
                    self._taken.clear()
                    await self._taken.wait()
        except ConnectionClosed:
            pass
        finally:
            self._feed.remove(self._viewer)
            for task in (sender, *self._tasks, *([self._replay] if self._replay else [])):
                task.cancel()

    def _take(self, text: str | bytes) -> None:
        try:
            asked = decode(text)
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            self._say({"error": f"this request is none: {error}"})
            return
        match asked:
            case Watch(detail=detail, hidden=hidden):
                self._viewer.detail = None if detail is None else f"contact/{detail}".encode()
                self._viewer.hidden = hidden
            case Ping(sent_ms=sent_ms):
                recordings = self._commands.recordings
                self._say({"pong": sent_ms, "now_ns": self._feed.now_ns(), "left_out": self._viewer.left_out,
                           "recording": recordings.under_way, "recording_failed": recordings.failure()})  # fmt: skip
            case Replay(name=None):
                self._show_bus()
                self._say({"id": asked.id, "done": {}})
            case _ if len(self._tasks) >= REQUESTS_AT_ONCE:
                self._say({"id": asked.id, "error": "this page waits for several answers already"})
            case _:
                does = self._show(asked) if isinstance(asked, Replay) else self._commands.carry_out(asked, self._say)
                task = asyncio.create_task(does)
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

    def _say(self, answer: dict[str, Any]) -> None:
        if "progress" in answer and len(self._said) >= ANSWERS_KEPT:
            return  # a later one replaces it
        self._said.append(json.dumps(answer))
        self._ready.set()

    async def _send(self) -> None:
        """Sends waiting messages as fast as the page takes them: meanwhile newer contacts replace older ones."""
        while True:
            await self._ready.wait()
            self._ready.clear()
            # Taken together, so that an answer to `replay` comes before all messages that it is about.
            said, self._said, batch = self._said, [], self._viewer.batch()
            self._taken.set()
            for text in said:
                await self._socket.send(text)
            if batch:
                await self._socket.send(batch)

    def _show_bus(self) -> None:
        self._end_replay()
        self._feed.add(self._viewer)

    def _end_replay(self) -> None:
        """Older waiting messages are dropped: they would be drawn among the new ones."""
        if self._replay is not None:
            self._replay.cancel()
            self._replay = None
        self._viewer.forget()

    async def _show(self, asked: Replay) -> None:
        """Show a recording in place of the bus. If it cannot be read, the present view continues."""
        assert asked.name is not None
        try:
            path = self._commands.recordings.path_of(asked.name)
            pads = await asyncio.to_thread(pads_of, path)
            first_ns, last_ns = await asyncio.to_thread(time_span_ns, path)
        except ERRORS as error:
            self._say({"id": asked.id, "error": str(error)})
            return
        self._end_replay()
        self._feed.remove(self._viewer)
        self._say(
            {"id": asked.id, "done": {"pads": pads, "recording": asked.name, "lasts_s": (last_ns - first_ns) * 1e-9}}
        )
        since_ns = first_ns + round(asked.from_s * 1e9)
        self._replay = asyncio.create_task(self._play(path, asked.speed, since_ns))

    async def _play(self, path: Path, speed: float, since_ns: int) -> None:
        over = threading.Event()
        why = ""
        try:
            messages = messages_of(path, over.is_set, since_ns)
            first_ns = 0
            begun_s = time.monotonic()
            while chunk := await asyncio.to_thread(lambda: list(islice(messages, AT_ONCE))):
                for sent_ns, topic, body in chunk:
                    first_ns = first_ns or sent_ns
                    due_s = begun_s + (sent_ns - first_ns) * 1e-9 / speed
                    if due_s - time.monotonic() > BATCH_S:
                        self._put_clock(sent_ns)
                        await asyncio.sleep(due_s - time.monotonic())
                    self._viewer.take(topic, body)
        except ERRORS as error:
            why = str(error)
        finally:
            over.set()
        self._viewer.take(b"replayed", msgpack.packb({"why": why}))

    def _put_clock(self, now_ns: int) -> None:
        """Tells the page what time it is in the recording, and sends what is due."""
        self._viewer.take(b"clock", msgpack.packb({"now_ns": now_ns}))
        self._ready.set()
