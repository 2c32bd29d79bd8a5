"""Writes and reads recordings: MCAP files (mcap.dev) with each message as JSON, in the schema of docs/messages.md.

A recorder that is killed loses its last chunk at most, which is a second of messages.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import msgspec
import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from fmfts.bus.messages import (
    AnyMessage,
    ContactMessage,
    EarlyMessage,
    EventMessage,
    FrameMessage,
    StateMessage,
    StatusMessage,
)
from fmfts.common.reading import open_regular
from fmfts.recording.output import McapFile, NotWrittenError, RecordingError
from fmfts.recording.plain_schema import plain_schema, with_nulls, without_nulls
from fmfts.recording.scene import Drawn

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
]

PROFILE = "fmfts"
HEADER_BYTES = 8
LARGEST_CHUNK, LARGEST_RECORD, LARGEST_MESSAGE = 1 << 25, 1 << 26, 1 << 20


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

    def _write(self, topic: str, name: str, kind: type[msgspec.Struct], message: bytes, utc_ns: int) -> None:
        with self.disk():
            channel = self._channels.get(topic)
            if channel is None:
                schema = self.writer.register_schema(name, "jsonschema", msgspec.json.encode(plain_schema(kind)))
                channel = self._channels[topic] = self.writer.register_channel(topic, "json", schema)
            self.writer.add_message(channel, utc_ns, message, utc_ns)


class CopyWriter(McapFile):
    """Writes records of another recording into a new file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, PROFILE)
        self._schemas: dict[int, int] = {0: 0}  # 0: a channel without a schema
        self._channels: dict[int, int] = {}

    def copy(self, record: Schema | Channel | Message) -> None:
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


def read(path: Path) -> Iterator[Recorded]:
    """Yields the messages in their order; of a file that was cut off (see `is_whole`), those before the cut.

    Raises RecordingError where the file is not a recording, or damaged.
    """
    topics: dict[int, str] = {}
    for record in records(path):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            kind, _, pad = topics.get(record.channel_id, "").partition("/")
            # Others are drawings, or another program's: MCAP files may be merged.
            if kind in KINDS and len(record.data) <= LARGEST_MESSAGE:
                yield Recorded(kind, pad, _decoded(path, kind, pad, record.data))


def records(path: Path) -> Iterator[McapRecord]:
    """Yields what is in the chunks of a recording, in order. Raises RecordingError, as `read`."""
    for record, end in _records(path):
        if isinstance(record, Chunk):
            yield from _unpacked(path, record, end)


def attachment(path: Path, name: str) -> bytes | None:
    """The first file of this name beside the messages; None if there is none. Raises RecordingError, as `read`."""
    for record, _ in _records(path):
        if isinstance(record, Attachment) and record.name == name:
            return record.data
    return None


def is_whole(path: Path) -> bool:
    """Is the file complete, with index and end?"""
    ended = any(isinstance(record, Footer) for record, _ in _records(path))
    with path.open("rb") as file:
        file.seek(-len(MCAP0_MAGIC), os.SEEK_END)
        return ended and file.read() == MCAP0_MAGIC


def _records(path: Path) -> Iterator[tuple[McapRecord, int]]:
    """Yields each record with the position of its end."""
    end = 0
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise RecordingError(f"{path} is empty: its recorder has only just begun, or was stopped at once")
            try:
                present = cast(IO[bytes], _PresentContent(file))
                for record in StreamReader(present, emit_chunks=True, record_size_limit=LARGEST_RECORD).records:
                    end = file.tell()
                    yield record, end
            except (EndOfFile, struct.error):
                if os.fstat(file.fileno()).st_size < HEADER_BYTES:
                    raise InvalidMagic(b"") from None
                if present.read(1) or file.tell() < HEADER_BYTES:  # otherwise it is cut off, and good up to here
                    raise
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except InvalidMagic as error:
        raise RecordingError(f"{path} is not a recording: it does not begin as an MCAP file does") from error
    except RecordingError:
        raise
    except Exception as error:  # of the MCAP reader: which ones damaged bytes cause is not told anywhere
        raise RecordingError(f"{path} is not a recording, or damaged after byte {end}: {_text_of(error)}") from error


class _PresentContent:
    """The content that a file had when reading began.

    A recorder may still be writing the file. The MCAP reader would take the first part of a new chunk for the whole
    chunk, and report damage.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._left = os.fstat(file.fileno()).st_size

    def read(self, size: int) -> bytes:
        data = self._file.read(min(size, self._left))
        self._left -= len(data)
        return data


def _text_of(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".removesuffix(": ")


def _decoded(path: Path, kind: str, pad: str, data: bytes) -> AnyMessage:
    try:
        body = msgspec.json.decode(data, type=dict[str, Any])
        message = msgspec.convert(with_nulls(body, KINDS[kind]), KINDS[kind])
    except (msgspec.DecodeError, ValueError) as error:
        raise RecordingError(f"{path}: a message of {kind}/{pad}: {error}") from error
    if message.pad != pad:
        raise RecordingError(f"{path}: a message of {kind}/{pad} is for pad {message.pad!r}")
    return message


def _unpacked(path: Path, chunk: Chunk, end: int) -> list[McapRecord]:
    try:
        size = zstandard.frame_content_size(chunk.data) if chunk.compression == "zstd" else chunk.uncompressed_size
        if max(size, chunk.uncompressed_size) > LARGEST_CHUNK:
            raise ValueError(f"this program does not write a chunk of {size} bytes")
        return breakup_chunk(chunk, validate_crc=True)
    except Exception as error:  # of the MCAP reader and of zstandard
        raise RecordingError(f"{path} is damaged in the chunk that ends at byte {end}: {_text_of(error)}") from error
