"""Reads a pad's frames for a verb: from a running daemon, or, if none runs, from the device itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import msgspec

from fmfts.bus.frame_message import frame_of
from fmfts.bus.lock import serving_pid
from fmfts.bus.messages import FrameMessage
from fmfts.config import Config, PadConfig
from fmfts.sensor import Frame, Source, SourceError
from fmfts.sensor.chips import CHIPS
from fmfts.sources import open_sources
from fmfts_client import Subscription, request
from fmfts_client.endpoints import for_client, named_base

# Returns (time_ns, counts) of the board's load cell since the last call; they arrive with the frames of the board.
Counts = Callable[[], Sequence[tuple[int, int]]]


class FeedError(Exception):
    """The pad's frames cannot be read (exit code 69)."""


class Feed(Protocol):
    """A source of one pad's frames; no call blocks. `counts` reads the load cell of the pad's board, if it can be."""

    description: str
    counts: Counts | None

    def poll(self, now_ns: int) -> Sequence[Frame]:
        """The pad's frames since the last call. now_ns: the present time, on the frames' clock."""

    def board_uid(self) -> str:
        """The board's id of 24 hex digits; "" where it is not known or the source has none."""

    def close(self) -> None:
        """Close the device or the subscription."""


def open_feed(config: Config, pad: PadConfig) -> Feed:
    """The feed of a pad. Raises FeedError where neither a daemon nor the device can be opened."""
    endpoints = for_client(named_base(config.bus.endpoint))
    if serving_pid(endpoints.control) is not None:
        return DaemonFeed(pad, endpoints)
    return DeviceFeed(pad)


class DeviceFeed:
    """Frames of the device, which this process opens."""

    def __init__(self, pad: PadConfig) -> None:
        try:
            ((self.source, names),) = open_sources([pad])
        except SourceError as error:
            raise FeedError(str(error)) from error
        self._pad_index = next(iter(names))
        self.description = self.source.state.description
        self.counts = _load_cell(self.source)

    def poll(self, now_ns: int) -> list[Frame]:
        return [frame for frame in self.source.poll(now_ns) if frame.pad_index == self._pad_index]

    def board_uid(self) -> str:
        return str(self.source.state.board.get("uid", ""))

    def close(self) -> None:
        self.source.close()


class DaemonFeed:
    """Frames that a running daemon publishes for this subscription."""

    counts: Counts | None = None

    def __init__(self, pad: PadConfig, endpoints: Any) -> None:
        self.description = "the running daemon"
        self._pad = pad.name
        self._chip = CHIPS[pad.source.chip]
        self._endpoints = endpoints
        self._subscription = Subscription(("frame",), pad.name, endpoints)

    def poll(self, now_ns: int) -> list[Frame]:
        frames = []
        while (message := self._subscription.receive(0)) is not None:
            frames.append(frame_of(msgspec.convert(message.body, FrameMessage), chip=self._chip))
        return frames

    def board_uid(self) -> str:
        pads = request("probe", endpoint=self._endpoints)["pads"]
        return next((str(pad["board"].get("uid", "")) for pad in pads if pad["pad"] == self._pad), "")

    def close(self) -> None:
        self._subscription.close()


def _load_cell(source: Source) -> Counts | None:
    counts: Counts | None = getattr(source, "load_counts", None)
    return counts
