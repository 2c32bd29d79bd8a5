"""The requests that a page may send, answered by the daemon's control socket or by the recordings of this process.

A request is JSON with an `id`. Its answers have the same `id`: {progress} any number of times, then {done} or {error}.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from fmfts.view.facts import fact_lines
from fmfts_client import ControlError, EndpointError, Endpoints, request
from fmfts_page.recordings import Recordings, RecordingsError
from fmfts_recording.file import RecordingError

Name = Annotated[str, Meta(max_length=64)]
PadName = Annotated[str, Meta(pattern=r"^[\w-]{1,32}\Z")]
Number = Annotated[int, Meta(ge=0, le=2**31)]
READING_S, WORKING_S = 3.0, 10.0
Baseline = Literal["bare", "rest", "replaced", "turn", "refine", "restore", "undo_drift", "posture"]


class Watch(Struct, forbid_unknown_fields=True, tag="watch", tag_field="ask"):
    """The pad whose messages are all wanted, and whether the tab is hidden."""

    detail: PadName | None = None
    hidden: bool = False


class Ping(Struct, forbid_unknown_fields=True, tag="ping", tag_field="ask"):
    """For comparing clocks: answered with the time here."""

    sent_ms: float


class Read(Struct, forbid_unknown_fields=True, tag="read", tag_field="ask"):
    id: Number
    verb: Literal["pads", "status", "probe"]


class Selftest(Struct, forbid_unknown_fields=True, tag="selftest", tag_field="ask"):
    id: Number
    pad: PadName


class RecordBaseline(Struct, forbid_unknown_fields=True, tag="baseline", tag_field="ask"):
    id: Number
    pad: PadName
    kind: Baseline


class Weigh(Struct, forbid_unknown_fields=True, tag="weigh", tag_field="ask"):
    """The verb `weigh`: a known weight on the pad, and the width below it."""

    id: Number
    pad: PadName
    weight_n: Annotated[float, Meta(gt=0.0, le=100.0)]
    width_m: Annotated[float, Meta(gt=0.0, le=0.1)]


class Record(Struct, forbid_unknown_fields=True, tag="record", tag_field="ask"):
    """Begins a recording of all pads, or ends the one under way."""

    id: Number
    on: bool


class ListRecordings(Struct, forbid_unknown_fields=True, tag="recordings", tag_field="ask"):
    id: Number


class Replay(Struct, forbid_unknown_fields=True, tag="replay", tag_field="ask"):
    """Shows a recording in place of the bus, from a place in it on; name None: the bus again."""

    id: Number
    name: Name | None
    speed: Annotated[float, Meta(ge=0.1, le=10.0)] = 1.0
    from_s: Annotated[float, Meta(ge=0.0, le=1e9)] = 0.0


Asked = Watch | Ping | Read | Selftest | RecordBaseline | Weigh | Record | ListRecordings | Replay
ERRORS = ControlError, EndpointError, RecordingError, RecordingsError
decode = msgspec.json.Decoder(Asked).decode
Say = Callable[[dict[str, Any]], None]


class Commands:
    """Carries out the requests of all pages. Each waits in a thread; `Say` sends to the page that asked."""

    def __init__(self, endpoints: Endpoints, recordings: Recordings) -> None:
        self._endpoints = endpoints
        self.recordings = recordings

    async def carry_out(self, asked: Any, say: Say) -> None:
        """Answer one request; `say` is called on the event loop."""
        loop = asyncio.get_running_loop()

        def progress(facts: dict[str, Any]) -> None:
            loop.call_soon_threadsafe(say, {"id": asked.id, "progress": facts})

        try:
            facts = await asyncio.to_thread(self._facts, asked, progress)
        except ERRORS as error:
            say({"id": asked.id, "error": str(error)})
            return
        say({"id": asked.id, "done": facts, "lines": fact_lines(facts)})

    def _facts(self, asked: Any, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
        match asked:
            case Read(verb=verb):
                return request(verb, endpoint=self._endpoints, timeout_s=READING_S)
            case Selftest(pad=pad):
                return self._work("selftest", progress, pad=pad)
            case RecordBaseline(pad=pad, kind=kind):
                return self._work("baseline", progress, pad=pad, **{kind: True})
            case Weigh(pad=pad, weight_n=weight_n, width_m=width_m):
                return self._work("weigh", progress, pad=pad, weight_n=weight_n, width_m=width_m)
            case Record(on=True):
                return self.recordings.begin()
            case Record():
                return self.recordings.end()
            case ListRecordings():
                return {"recordings": self.recordings.names(), "folder": str(self.recordings.folder)}
        raise AssertionError(asked)

    def _work(self, verb: str, progress: Callable[[dict[str, Any]], None], **arguments: Any) -> dict[str, Any]:
        return request(verb, endpoint=self._endpoints, timeout_s=WORKING_S, progress=progress, **arguments)
