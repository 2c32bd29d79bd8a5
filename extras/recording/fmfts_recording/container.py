"""Reads the records of an MCAP file within limits: it checks every length before it uses it.

A length that a record claims is compared with its limit, and with the bytes that the file has left, before anything of
that size is read or unpacked. The mcap package decodes what is in a record; it gets no more than that record's bytes.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from io import BytesIO
from itertools import repeat
from pathlib import Path
from typing import IO, NamedTuple
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Schema
from mcap.writer import MCAP0_MAGIC

from fmfts.common.reading import damage_told, open_regular
from fmfts_recording.output import RecordingError

# A recorder writes chunks of 1 MB, other programs chunks of 1 to 4 MB.
LARGEST_CHUNK, LARGEST_ATTACHMENT = 1 << 23, 1 << 24
# Channels and schemas, of which a program must keep all: how many, how many bytes of one, and of all.
MOST_DESCRIPTIONS, LARGEST_DESCRIPTION, LARGEST_DESCRIPTIONS = 4096, 1 << 20, 1 << 24
# Messages that repeat themselves shrink to a fortieth. A larger factor, after this many bytes, is an attack.
MOST_GROWTH, FREE_GROWTH = 100, 1 << 24
# A damaged length is probably huge; a smaller one beyond the file's end means that the file was cut off.
LARGEST_RECORD = 1 << 26
# Between two chunks there is an index for each channel.
MOST_UNREAD = 2 * MOST_DESCRIPTIONS
# ROS writes two or three; each takes microseconds to read.
MOST_METADATA = 64  # of a channel
MOST_FIELDS = 7 + 4 * MOST_METADATA  # a text is two fields: its length and its letters
# A reader that must not wait can pause after each part. The smallest record takes as long to read as this many bytes,
# and a channel as long as a part.
PART_BYTES, RECORD_BYTES = 1 << 16, 1 << 10

HEAD = struct.Struct("<BQ")  # kind and length of a record
HEAD_OF_MESSAGE = struct.Struct("<HIQQ")
HEAD_OF_CHUNK = struct.Struct("<QQ")
FOOTER_BYTES = HEAD.size + 20
LIMITS = {Opcode.CHUNK: LARGEST_CHUNK + 1024, Opcode.ATTACHMENT: LARGEST_ATTACHMENT + 1024}

Record = Schema | Channel | Message


class _Raw(NamedTuple):
    """A record as it stands in the file. end: the position after it."""

    kind: int
    content: bytes
    end: int


def chunk_records(path: Path) -> Iterator[Record | None]:
    """Yields what is in the chunks, in order. None marks the end of a part, where a reader may pause.

    The records between two None take as long to read as PART_BYTES of messages, whether they are yielded or skipped.
    After a larger record there are several None. Only a chunk is read and unpacked in one go.

    From a truncated file it yields what is before the cut. Raises RecordingError where the file is no recording,
    is damaged, or exceeds a limit.
    """
    described: dict[tuple[type[Record], int], int] = {}  # channels and schemas → their bytes
    total = unpacked = work = 0
    for raw in _raw_records(path, {Opcode.CHUNK}):
        if raw is None:
            yield None
            continue
        with damage_told(RecordingError, f"{path} is damaged in the chunk that ends at byte {raw.end}"):
            data = _unpacked(Chunk.read(_Content(raw.content)))
            unpacked += len(data)
            if unpacked > FREE_GROWTH + MOST_GROWTH * raw.end:
                raise ValueError(f"the file unpacks to more than {MOST_GROWTH} times its size")
            yield None
            for record, size in _records_in(data):
                work += max(size, RECORD_BYTES)
                if isinstance(record, Schema | Channel):
                    work += PART_BYTES
                    total += size - described.get((type(record), record.id), 0)
                    described[type(record), record.id] = size
                    if len(described) > MOST_DESCRIPTIONS or total > LARGEST_DESCRIPTIONS:
                        raise ValueError("it describes more channels than any recording has")
                if record is not None:
                    yield record
                parts, work = divmod(work, PART_BYTES)
                yield from repeat(None, parts)


def attachments(path: Path) -> Iterator[Attachment]:
    """Yields the files beside the messages. Raises RecordingError, as `chunk_records`."""
    for raw in _raw_records(path, {Opcode.ATTACHMENT}):
        if raw is not None:
            with damage_told(RecordingError, f"{path} is damaged in the attachment that ends at byte {raw.end}"):
                yield Attachment.read(_Content(raw.content))


def time_span_ns(path: Path) -> tuple[int, int]:
    """The times of the first and the last message, in UTC ns, as the chunks' heads have them. Reads no message.

    (0, 0) without a chunk. Raises RecordingError, as `chunk_records`.
    """
    heads = [
        HEAD_OF_CHUNK.unpack_from(raw.content)
        for raw in _raw_records(path, {Opcode.CHUNK})
        if raw is not None and len(raw.content) >= HEAD_OF_CHUNK.size
    ]
    return (min(first for first, _ in heads), max(last for _, last in heads)) if heads else (0, 0)


def is_whole(path: Path) -> bool:
    """Does the file end as a complete one does, with index and end? Raises RecordingError where it cannot be read."""
    try:
        with open_regular(path) as file:
            file.seek(max(os.fstat(file.fileno()).st_size - FOOTER_BYTES - len(MCAP0_MAGIC), 0))
            end = file.read()
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    return end[:1] == bytes([Opcode.FOOTER]) and end[FOOTER_BYTES:] == MCAP0_MAGIC


def _raw_records(path: Path, wanted: Collection[int]) -> Iterator[_Raw | None]:
    """Yields the records of the kinds `wanted`, and skips the others unread: None after each part of these."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size  # the present size: a recorder may still be writing
            if size == 0:
                raise RecordingError(f"{path} is empty: its recorder has only just begun, or was stopped at once")
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise RecordingError(f"{path} is not a recording: it does not begin as an MCAP file does")
            yield from _raw_records_in(path, file, size, wanted)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error


def _raw_records_in(path: Path, file: IO[bytes], size: int, wanted: Collection[int]) -> Iterator[_Raw | None]:
    at, unread, skipped = len(MCAP0_MAGIC), 0, 0
    while size - at >= HEAD.size:
        kind, length = HEAD.unpack(file.read(HEAD.size))
        begin = at + HEAD.size
        # A power cut leaves zeros behind.
        if kind in (0, Opcode.DATA_END) or size - begin < length <= LARGEST_RECORD:
            return
        damaged = f"{path} is not a recording, or damaged after byte {at}"
        if length > size - begin:
            raise RecordingError(f"{damaged}: a record of {length} bytes begins there")
        at = begin + length
        if kind in wanted:
            if length > LIMITS[Opcode(kind)]:
                raise RecordingError(f"{damaged}: a record of {length} bytes is larger than this program reads")
            unread = 0
            yield _Raw(kind, file.read(length), at)
        else:
            # A report's facts may follow all chunks of a recording.
            unread = 0 if kind == Opcode.CHUNK else unread + 1
            skipped += 1
            if skipped % (PART_BYTES // RECORD_BYTES) == 0:
                yield None
            if unread > MOST_UNREAD:
                raise RecordingError(f"{damaged}: more than {MOST_UNREAD} records in a row are no chunks")
            file.seek(at)


class _Content(ReadDataStream):
    """The content of one record. A field that is longer than the record is damaged; the base class truncates it."""

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self._fields = 0

    def read(self, length: int) -> bytes:
        self._fields += 1
        if self._fields > MOST_FIELDS:
            raise ValueError(f"a channel in it has more than {MOST_METADATA} entries of metadata")
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise ValueError(f"a chunk of {size} bytes is larger than this program reads")
    if chunk.compression == "zstd":
        window = zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)
        data = window.stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"its compression {chunk.compression[:20]!r} is unknown")
    if len(data) != size:
        raise ValueError(f"it claims {size} bytes, and holds {'more' if len(data) > size else len(data)}")
    if chunk.uncompressed_crc not in (0, crc32(data)):
        raise ValueError("its checksum does not match")
    return data


def _records_in(data: bytes) -> Iterator[tuple[Record | None, int]]:
    """Yields the records in a chunk, each with its size; None instead of one of another kind."""
    at = 0
    while at < len(data):
        kind, length = HEAD.unpack_from(data, at)
        begin, at = at + HEAD.size, at + HEAD.size + length
        if at > len(data):
            raise ValueError(f"a record in it claims {length} bytes")
        if kind == Opcode.MESSAGE:
            if length < HEAD_OF_MESSAGE.size:
                raise ValueError("a message in it has no beginning")
            channel, sequence, logged, published = HEAD_OF_MESSAGE.unpack_from(data, begin)
            yield Message(channel, logged, data[begin + HEAD_OF_MESSAGE.size : at], published, sequence), length
        elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
            if length > LARGEST_DESCRIPTION:
                raise ValueError(f"a channel or its schema has {length} bytes")
            content = _Content(data[begin:at])
            yield Schema.read(content) if kind == Opcode.SCHEMA else Channel.read(content), length
        else:
            yield None, length
