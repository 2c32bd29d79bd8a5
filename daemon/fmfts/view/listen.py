"""`fmfts-daemon listen`: shows contacts as they arrive, as a picture in a terminal, as lines of a log, or as JSON."""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from fmfts.common import exit_codes
from fmfts.view.picture import render_contact
from fmfts.view.places import sensor_places
from fmfts.view.silence import NoSuchPadError, require_pad, why_nothing_came
from fmfts.view.surface import Places
from fmfts.view.tally import Tally, now_line
from fmfts_client import (
    Contact,
    EndpointError,
    Endpoints,
    Event,
    Message,
    MessageError,
    SchemaError,
    Status,
    Subscription,
)

PICTURES_PER_SECOND = 12
ASK_AGAIN_S = 5.0  # whether the daemon has the pad, while nothing of it arrives
log = logging.getLogger(__name__)


class _Output(Protocol):
    """A way to show messages; `interval_s`: time between calls of `refresh`."""

    interval_s: float

    def message(self, message: Message) -> None: ...
    def refresh(self) -> None: ...
    def end(self) -> None: ...


def listen(
    pad: str | None = None,
    seconds: float | None = None,
    out: TextIO | None = None,
    *,
    as_json: bool = False,
    endpoint: str | None = None,
) -> int:
    """Show `pad` (None: all) for `seconds` (None: until Ctrl-C), then a summary. Returns the exit code.

    0; USAGE when the daemon has no such pad; UNAVAILABLE when there is nothing to listen to: no endpoint can be found,
    the daemon has another schema, or no message arrived in `seconds`.
    """
    out = sys.stdout if out is None else out
    try:
        with Subscription(("contact", "event", "status"), pad, endpoint) as subscription, _stopped_by_signals():
            require_pad(subscription.endpoints, pad)
            return _listen(subscription, pad, seconds, out, as_json)
    except (EndpointError, SchemaError, NoSuchPadError) as error:
        log.error("%s", error)
        return exit_codes.code_of(error)
    except BrokenPipeError:  # the reader of a pipe ended (`listen | head`): discard what is still buffered
        os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())
        return 0


def _listen(subscription: Subscription, pad: str | None, seconds: float | None, out: TextIO, as_json: bool) -> int:
    tallies: dict[str, Tally] = {}
    waiting = f"waiting for {'fmfts-daemon' if pad is None else f'pad {pad}'} on {subscription.endpoints.bus} …"
    output: _Output
    if as_json:
        output = _Json(out)
    elif out.isatty():
        output = _Pictures(tallies, waiting, out, subscription.endpoints)
    else:
        output = _Lines(tallies, waiting, out)
    end = None if seconds is None else time.monotonic() + seconds
    try:
        for message in _messages(subscription, output, end, pad):
            try:
                _count(tallies, message)
            except MessageError as error:
                subscription.refuse(error)
            else:
                output.message(message)
    except KeyboardInterrupt:
        pass  # the usual end
    finally:
        output.end()
    _summarise(tallies, subscription, pad, out, as_json)
    if seconds is not None and not tallies:
        return exit_codes.UNAVAILABLE
    return 0


def _messages(subscription: Subscription, output: _Output, end: float | None, pad: str | None) -> Iterator[Message]:
    """Yields messages until `end`, and refreshes the output in between.

    Raises NoSuchPadError, also where the daemon was too busy to say so at first, or starts later.
    """
    refresh = time.monotonic()
    ask_again, is_heard = refresh + ASK_AGAIN_S, pad is None
    while end is None or time.monotonic() < end:
        if not is_heard and time.monotonic() >= ask_again:
            require_pad(subscription.endpoints, pad)
            ask_again = time.monotonic() + ASK_AGAIN_S
        if time.monotonic() >= refresh:
            output.refresh()
            refresh = time.monotonic() + output.interval_s
        message = subscription.receive(max(0.0, min(refresh, end or refresh) - time.monotonic()))
        if message is not None:
            is_heard = True
            yield message


def _count(tallies: dict[str, Tally], message: Message) -> None:
    if message.kind == "contact":
        contact = Contact.from_message(message.body, message.clock_ahead_s)
        tallies.setdefault(message.pad, Tally(message.pad)).add(contact)
    elif message.kind == "status":
        status = Status.from_message(message.body)
        if message.pad in tallies:
            tallies[message.pad].status = status
    else:
        Event.from_message(message.body)


def _summarise(
    tallies: dict[str, Tally], subscription: Subscription, pad: str | None, out: TextIO, as_json: bool
) -> None:
    if as_json:
        facts = [tallies[pad].facts() for pad in sorted(tallies)]
        print(json.dumps({"topic": "summary", "pads": facts, "refused": subscription.refused}), file=out)
        return
    for pad in sorted(tallies):
        print(tallies[pad].sentence(), file=out)
    if not tallies:
        print(
            f"nothing arrived from {subscription.endpoints.bus}: {why_nothing_came(subscription.endpoints, pad)}",
            file=out,
        )
    if subscription.refused:
        print(f"{subscription.refused} messages refused; the last: {subscription.refusal}", file=out)
    out.flush()


@contextmanager
def _stopped_by_signals() -> Iterator[None]:
    """Makes SIGTERM end like Ctrl-C, so that the terminal's cursor is shown again."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _event_line(message: Message) -> str:
    event = Event.from_message(message.body)
    kind = "" if event.kind in ("overload", "rejected") else f"{event.kind} "  # their texts say what happened
    return f"{event.pad}: {kind}{event.detail}".rstrip()


class _Pictures:
    interval_s = 1.0 / PICTURES_PER_SECOND

    def __init__(self, tallies: dict[str, Tally], waiting: str, out: TextIO, endpoints: Endpoints) -> None:
        self._tallies = tallies
        self._waiting = waiting
        self._event = ""
        self._endpoints = endpoints
        self._sensors: dict[str, Places] = {}
        self._live = Live(console=Console(file=out, markup=False, highlight=False), auto_refresh=False)
        self._live.start()

    def message(self, message: Message) -> None:
        if message.kind == "event":
            self._event = _event_line(message)

    def refresh(self) -> None:
        compact = len(self._tallies) > 1
        pictures = [self._picture(self._tallies[pad], compact) for pad in sorted(self._tallies)]
        shown = Columns(pictures) if pictures else Text(self._waiting)
        self._live.update(Group(shown, Text(self._event or " ", "bright_black", no_wrap=True)), refresh=True)

    def end(self) -> None:
        self._live.stop()

    def _picture(self, tally: Tally, compact: bool) -> RenderableType:
        if tally.contact is None or not tally.alive:
            return Text(now_line(tally), "bold red")
        if tally.pad not in self._sensors:
            self._sensors |= {tally.pad: ()} | sensor_places(self._endpoints)
        return render_contact(
            tally.contact,
            tally.status,
            tally.rate_hz,
            tally.arrival_s,
            compact,
            self._live.console.width,
            self._sensors[tally.pad],
        )


class _Lines:
    interval_s = 1.0

    def __init__(self, tallies: dict[str, Tally], waiting: str, out: TextIO) -> None:
        self._tallies = tallies
        self._waiting = waiting
        self._out = out

    def message(self, message: Message) -> None:
        if message.kind == "event":
            print(_event_line(message), file=self._out, flush=True)

    def refresh(self) -> None:
        for line in [now_line(self._tallies[pad]) for pad in sorted(self._tallies)] or [self._waiting]:
            print(line, file=self._out, flush=True)

    def end(self) -> None:
        """Nothing to put back."""


class _Json:
    interval_s = 1.0

    def __init__(self, out: TextIO) -> None:
        self._out = out

    def message(self, message: Message) -> None:
        line = json.dumps({"topic": f"{message.kind}/{message.pad}", **message.body}, default=repr)
        print(line, file=self._out, flush=True)

    def refresh(self) -> None:
        """Each message is a line already."""

    def end(self) -> None:
        """Nothing to put back."""
