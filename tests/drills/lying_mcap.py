"""Makes MCAP files record by record, with correct checksums, so that a test may falsify any of their numbers."""

from __future__ import annotations

from collections.abc import Iterable
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Schema,
)
from mcap.writer import MCAP0_MAGIC

COMPRESSIONS = {"": bytes, "zstd": zstandard.ZstdCompressor().compress, "lz4": lz4.frame.compress}


def packed(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def record(kind: int, content: bytes, claimed: int | None = None) -> bytes:
    """A record of any kind. claimed: the length that it states; None: the right one."""
    length = len(content) if claimed is None else claimed
    return bytes([kind]) + length.to_bytes(8, "little") + content


def chunk(records: bytes, compression: str = "zstd", claimed: int | None = None, stored: bytes | None = None) -> bytes:
    """claimed: the size that it states; None: the right one. stored: the compressed data; None: made of `records`."""
    size = len(records) if claimed is None else claimed
    data = COMPRESSIONS.get(compression, bytes)(records) if stored is None else stored
    return packed(Chunk(compression, data, 0, 0, crc32(records), size))


def mcap(parts: Iterable[bytes]) -> bytes:
    """A whole file of records, most of them chunks."""
    end = packed(DataEnd(0), Footer(0, 0, 0))
    return MCAP0_MAGIC + packed(Header("fmfts", "lying")) + b"".join(parts) + end + MCAP0_MAGIC


def channel(number: int, topic: str, metadata: dict[str, str] | None = None) -> bytes:
    return packed(Channel(number, topic, "json", metadata or {}, 0))


def schema(number: int, name: str, data: bytes) -> bytes:
    return packed(Schema(number, data, "jsonschema", name))


def message(channel_number: int, data: bytes) -> bytes:
    return packed(Message(channel_number, 0, data, 0, 0))


def indexed(channel_number: int) -> bytes:
    return packed(MessageIndex(channel_number, []))


def attached(name: str, data: bytes) -> bytes:
    return packed(Attachment(0, 0, name, "application/json", data))
