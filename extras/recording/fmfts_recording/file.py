"""Writes and reads recordings: MCAP files (mcap.dev) with each message as JSON, in the schema of docs/messages.md.

A recorder that is killed loses its last chunk at most, which is a second of messages.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel, Message, Schema

from fmfts.bus.messages import (
    AnyMessage,
    ContactMessage,
    EarlyMessage,
    EventMessage,
    FrameMessage,
    StateMessage,
    StatusMessage,
)
from fmfts.common.reading import damage_told
from fmfts_recording.container import Record, attachments, chunk_records, is_whole, time_span_ns
from fmfts_recording.output import McapFile, NotWrittenError, RecordingError
from fmfts_recording.plain_schema import plain_schema, with_nulls, without_nulls
from fmfts_recording.ros2 import SCHEMAS, RosMessage
from fmfts_recording.scene import Drawn

KINDS: dict[str, type[AnyMessage]] = {
    "contact": ContactMessage,
    "event": EventMessage,
    "status": StatusMessage,
    "frame": FrameMessage,
    "early": EarlyMessage,
    "state": StateMessage,
}
__all__ = [
    "KINDS",
    "CopyWriter",
    "NotWrittenError",
    "Recorded",
    "RecordingError",
    "RecordingWriter",
    "attachment",
    "is_whole",
    "read",
    "read_in_parts",
    "records",
    "time_span_ns",
]

PROFILE = "fmfts"
HEADER_BYTES = 8
LARGEST_MESSAGE = 1 << 20
LONGEST_TOPIC = 64  # bytes of a topic; the name of a pad has at most 32 letters


@dataclass(frozen=True, slots=True)
class Recorded:
    """A message of a recording. kind: a key of KINDS."""

    kind: str
    pad: str
    message: AnyMessage


class RecordingWriter(McapFile):
    """Writes a new file. Raises NotWrittenError where it exists already, or cannot be made."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, PROFILE)
        self._channels: dict[str, int] = {}

    def add(self, kind: str, pad: str, body: dict[str, Any]) -> None:
        """Write a message. body: as it arrived from the bus. Raises NotWrittenError where the disk is full."""
        message = msgspec.json.encode(without_nulls(body, KINDS[kind]))
        self._write(f"{kind}/{pad}", f"fmfts.{kind}", KINDS[kind], message, body["utc_ns"])
        self.messages += 1

    def draw(self, drawn: Drawn, utc_ns: int) -> None:
        """Write a message for Foxglove's 3-D panel, which a replay leaves out."""
        body = without_nulls(msgspec.to_builtins(drawn.message), type(drawn.message))
        self._write(drawn.topic, drawn.schema, type(drawn.message), msgspec.json.encode(body), utc_ns)

    def tell_ros(self, told: RosMessage, utc_ns: int) -> None:
        """Write a message for programs that read ROS 2, which a replay leaves out."""
        with self.disk():
            channel = self._channels.get(told.topic)
            if channel is None:
                text = SCHEMAS[told.schema].encode()
                channel = self._channel(told.topic, "cdr", self.writer.register_schema(told.schema, "ros2msg", text))
            self.writer.add_message(channel, utc_ns, told.data, utc_ns)

    def _write(self, topic: str, name: str, kind: type[msgspec.Struct], message: bytes, utc_ns: int) -> None:
        with self.disk():
            channel = self._channels.get(topic)
            if channel is None:
                schema = self.writer.register_schema(name, "jsonschema", msgspec.json.encode(plain_schema(kind)))
                channel = self._channel(topic, "json", schema)
            self.writer.add_message(channel, utc_ns, message, utc_ns)

    def _channel(self, topic: str, encoding: str, schema: int) -> int:
        channel = self._channels[topic] = int(self.writer.register_channel(topic, encoding, schema))
        return channel


class CopyWriter(McapFile):
    """Writes records of another recording into a new file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, PROFILE)
        self._schemas: dict[int, int] = {0: 0}  # 0: a channel without a schema
        self._channels: dict[int, int] = {}

    def copy(self, record: Record) -> None:
        """Write a record after those that it refers to. Raises NotWrittenError where the disk is full."""
        with self.disk():
            if isinstance(record, Schema):
                if record.id not in self._schemas:
                    self._schemas[record.id] = self.writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                if record.id not in self._channels:
                    self._channels[record.id] = self.writer.register_channel(
                        record.topic, record.message_encoding, self._schemas[record.schema_id], record.metadata
                    )
            else:
                channel = self._channels[record.channel_id]
                self.writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
                self.messages += 1


def read(path: Path, since_ns: int = 0) -> Iterator[Recorded]:
    """Yields the messages in their order; of a file that was cut off (see `is_whole`), those before the cut.

    since_ns: UTC; earlier messages are left out.

    Raises RecordingError where the file is not a recording, damaged, or larger in a part than this program reads.
    """
    return (one for one in read_in_parts(path, since_ns=since_ns) if one is not None)


def read_in_parts(
    path: Path, kinds: Collection[str] = KINDS.keys(), largest: int = LARGEST_MESSAGE, since_ns: int = 0
) -> Iterator[Recorded | None]:
    """As `read`, but decodes messages of these kinds only, of at most `largest` bytes, and from `since_ns` (UTC) on.

    None marks the end of a part, as in `chunk_records`.
    """
    topics: dict[int, str] = {}
    for record in chunk_records(path):
        if record is None:
            yield None
        elif isinstance(record, Channel):
            topics[record.id] = record.topic[:LONGEST_TOPIC]
        elif isinstance(record, Message):
            kind, _, pad = topics.get(record.channel_id, "").partition("/")
            # Others are drawings, or another program's: MCAP files may be merged.
            if kind in kinds and len(record.data) <= largest and record.log_time >= since_ns:
                yield Recorded(kind, pad, _decoded(path, kind, pad, record.data))


def records(path: Path) -> Iterator[Record]:
    """Yields what is in the chunks of a recording, in order. Raises RecordingError, as `read`."""
    return (record for record in chunk_records(path) if record is not None)


def attachment(path: Path, name: str) -> bytes | None:
    """The first file of this name beside the messages; None if there is none. Raises RecordingError, as `read`."""
    return next((each.data for each in attachments(path) if each.name == name), None)


def _decoded(path: Path, kind: str, pad: str, data: bytes) -> AnyMessage:
    with damage_told(RecordingError, f"{path}: a message of {kind}/{pad} is damaged or another version's"):
        body = msgspec.json.decode(data, type=dict[str, Any])
        message = msgspec.convert(with_nulls(body, KINDS[kind]), KINDS[kind])
    if message.pad != pad:
        raise RecordingError(f"{path}: a message of {kind}/{pad} is for pad {message.pad[:LONGEST_TOPIC]!r}")
    return message
