"""Writes and reads recordings: MCAP files (mcap.dev) with each message as JSON, in the schema of docs/messages.md.

A recorder that is killed loses its last chunk at most, which is a second of messages.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import msgspec
import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import Channel, Chunk, Footer, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from fmfts.bus.messages import AnyMessage, ContactMessage, EventMessage, FrameMessage, StateMessage, StatusMessage
from fmfts.common.reading import damage_told, open_regular
from fmfts.common.writing import why_not_written

KINDS: dict[str, type[AnyMessage]] = {
    "contact": ContactMessage,
    "event": EventMessage,
    "status": StatusMessage,
    "frame": FrameMessage,
    "state": StateMessage,
}
PROFILE = "fmfts"
CHUNK_BYTES = 1 << 20
HEADER_BYTES = 8
LARGEST_CHUNK, LARGEST_RECORD, LARGEST_MESSAGE = 1 << 25, 1 << 26, 1 << 20


class RecordingError(Exception):
    """A recording cannot be written or read; the text names the file, why, and what to do."""


class NotWrittenError(RecordingError):
    """A recording cannot be written."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A message of a recording. kind: a key of KINDS."""

    kind: str
    pad: str
    message: AnyMessage


class RecordingWriter:
    """Writes a new file. Raises NotWrittenError where it exists already, or cannot be made."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.messages = 0
        self._channels: dict[tuple[str, str], int] = {}
        try:
            self._output = _Output(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640))
            self._writer: Any = Writer(
                cast(IO[bytes], self._output), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD
            )
            self._writer.start(PROFILE)
            self.flush()
        except FileExistsError as error:
            raise NotWrittenError(
                f"{path}: {error.strerror}: a recording is never overwritten; give another name"
            ) from error
        except OSError as error:
            raise NotWrittenError(f"{path}: {why_not_written(error)}") from error

    def add(self, kind: str, pad: str, body: dict[str, Any]) -> None:
        """Write a message. body: as it arrived from the bus. Raises NotWrittenError where the disk is full."""
        with _disk(self.path):
            channel = self._channels.get((kind, pad))
            if channel is None:
                schema = msgspec.json.encode(msgspec.json.schema(KINDS[kind]))
                schema_id = self._writer.register_schema(f"fmfts.{kind}", "jsonschema", schema)
                channel = self._writer.register_channel(f"{kind}/{pad}", "json", schema_id)
                self._channels[kind, pad] = channel
            now_ns = body["utc_ns"]
            self._writer.add_message(channel, now_ns, msgspec.json.encode(body), now_ns)
            self.messages += 1

    def flush(self) -> None:
        """End the chunk: its messages survive the end of this process. NotWrittenError: the disk is full."""
        with _disk(self.path):
            self._writer.flush()

    def sync(self) -> None:
        """Like flush, but the messages also survive a power cut."""
        self.flush()
        with _disk(self.path):
            self._output.sync()

    def finish(self) -> None:
        """Write the index, and end the file. A file without an index can be read too."""
        with _disk(self.path):
            self._writer.finish()
            self._output.sync()

    def discard(self) -> None:
        """Close and delete the file."""
        self.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        self._output.close()


def read(path: Path) -> Iterator[Recorded]:
    """Yields the messages in their order; of a file that was cut off (see `is_whole`), those before the cut.

    Raises RecordingError where the file is not a recording, or damaged.
    """
    topics: dict[int, str] = {}
    for record, end in _records(path):
        if isinstance(record, Chunk):
            yield from _messages(path, record, end, topics)


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


def _messages(path: Path, chunk: Chunk, end: int, topics: dict[int, str]) -> Iterator[Recorded]:
    for record in _unpacked(path, chunk, end):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            kind, _, pad = topics.get(record.channel_id, "").partition("/")
            if kind not in KINDS or len(record.data) > LARGEST_MESSAGE:
                continue  # another program's channel: MCAP files may be merged
            with damage_told(RecordingError, f"{path}: a message of {kind}/{pad} is damaged"):
                message = msgspec.json.decode(record.data, type=KINDS[kind])
            if message.pad != pad:
                raise RecordingError(f"{path}: a message of {kind}/{pad} is for pad {message.pad!r}")
            yield Recorded(kind, pad, message)


def _unpacked(path: Path, chunk: Chunk, end: int) -> list[McapRecord]:
    try:
        size = zstandard.frame_content_size(chunk.data) if chunk.compression == "zstd" else chunk.uncompressed_size
        if max(size, chunk.uncompressed_size) > LARGEST_CHUNK:
            raise ValueError(f"this program does not write a chunk of {size} bytes")
        return breakup_chunk(chunk, validate_crc=True)
    except Exception as error:  # of the MCAP reader and of zstandard
        raise RecordingError(f"{path} is damaged in the chunk that ends at byte {end}: {_text_of(error)}") from error


class _Output:
    """A file that writes all data or raises, because the MCAP writer does not check how much was written."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._written = 0

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        while left:
            count = os.write(self._descriptor, left)
            if count == 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            left = left[count:]
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        return self._written

    def flush(self) -> None:
        """Nothing to do: `write` does not buffer."""

    def sync(self) -> None:
        os.fsync(self._descriptor)

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


@contextmanager
def _disk(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise NotWrittenError(f"{path}: {why_not_written(error)}; the messages before can be read from it") from error
