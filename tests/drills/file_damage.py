"""Damages files: their bytes, or the contents of a document or container, rewritten so that a reader accepts the outer
form."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

from mcap.records import Channel, Message, Schema

from drills.lying_mcap import chunk, mcap, packed, record
from fmfts_recording.file import records

WEIRD: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 2**63, 10**400, -(2**63), 0.0, -0.5, 1e-300, 1e300, 1.5, "", "left", "é\x00",
    "9" * 5000, [], {}, [[]], [1.0, 2.0], {"": None}, "NaN", "2024-01-01",
)  # fmt: skip
# Replacements for any value in a text: Python's and the packages' decoders read them differently.
TOKENS = (
    b"1e400", b"-1e400", b"NaN", b"nan", b"inf", b"Infinity", b"-0", b"1e-400", b"9" * 400, b"9" * 5000, b"0x7f",
    b"18446744073709551616", b"9223372036854775808", b'"\\ud800"', b'"\\u0000"', b'{"a":1,"a":2}', b"[" * 3000,
    b'{"a":' * 3000, b"null", b"true", b"[]", b"{}", b'""', b"-1", b'"' + b"x" * 20_000 + b'"', b"\xff",
    b"\xed\xa0\x80",
)  # fmt: skip
VALUE = re.compile(rb'-?\d[\d.e+-]*|true|false|null|"[^"\\]*"')
DOUBLED = (2, 10, 100, 1000)  # how often a part of a file is repeated
LARGE = 1 << 18  # a file that is extended has about this many bytes
MANY = LARGE // 9  # number of the smallest parts: empty records, entries of metadata
MANY_EMPTY = record(0x7F, b"") * MANY
HUGE = (0, 1, 2**7, 2**16, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1)


def damaged(whole: bytes, dice: Random) -> bytes:
    """Bits flipped, bytes replaced, left out, doubled, inserted; or cut off."""
    spoilt = bytearray(whole)
    for _ in range(dice.choice((1, 1, 1, 2, 5, 40))):
        at = dice.randrange(len(spoilt) + 1)
        some = dice.randrange(1, 20)
        match dice.randrange(7):
            case 0 if at < len(spoilt):
                spoilt[at] ^= 1 << dice.randrange(8)
            case 1 if at < len(spoilt):
                spoilt[at] = dice.choice((0, 0xFF, 0x80, 0xC3, dice.randrange(256)))
            case 2:
                del spoilt[at : at + some]
            case 3:
                spoilt[at:at] = spoilt[at : at + some]
            case 4:
                spoilt[at:at] = dice.randbytes(some)
            case 5:
                spoilt[at : at + some] = dice.choice((b"1e999", b"-", b"NaN", b"[" * 2000, b"\x00", b'"', b"9" * 30))
            case _ if dice.random() < 0.2:
                del spoilt[at:]
    return bytes(spoilt)


def mutated(document: Any, dice: Random) -> Any:
    """The document with one value replaced, dropped, or repeated, anywhere in it."""
    document = copy.deepcopy(document)
    at: Any = document
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        if not keys:
            return document
        key = dice.choice(keys)
        if isinstance(at[key], (dict, list)) and at[key] and dice.random() < 0.9:
            at = at[key]
            continue
        match dice.randrange(5):
            case 0:
                del at[key]
            case 1 if isinstance(at, list):
                at.extend([at[key]] * dice.choice(DOUBLED))
            case 2 if isinstance(at[key], bytes):
                at[key] = dice.choice((b"", at[key] * 2, at[key][:-8], dice.randbytes(64), b"\xff" * len(at[key])))
            case _:
                at[key] = dice.choice(WEIRD)
        return document


def retokened(text: bytes, dice: Random) -> bytes:
    """The text with one value replaced by another token, or one line repeated."""
    if dice.random() < 0.1 and (lines := text.splitlines(keepends=True)):
        line = dice.choice(lines)
        return text + line * min(dice.choice(DOUBLED), LARGE // max(len(line), 1))
    values = list(VALUE.finditer(text))
    if not values:
        return text + dice.choice(TOKENS)
    value = dice.choice(values)
    return text[: value.start()] + dice.choice(TOKENS) + text[value.end() :]


def toml_of(document: Any) -> bytes:
    """Lists every value in one line. Values that TOML cannot express are dropped."""

    def pairs(table: dict[str, Any]) -> list[str]:
        return [f"{json.dumps(key)} = {shown(value)}" for key, value in table.items() if value is not None]

    def shown(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(pairs(value)) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(shown(one) for one in value if one is not None) + "]"
        return json.dumps(value)

    return "\n".join(pairs(document)).encode()


class LyingRecording:
    """Rewrites a recording with correct checksums, and one error in it."""

    def __init__(self, path: Path) -> None:
        self._records = list(records(path))

    def __call__(self, dice: Random) -> bytes:
        parts = list(self._records)
        at = dice.randrange(len(parts))
        one = parts[at]
        compression, claimed, repeated, extra = dice.choice(("", "zstd", "zstd", "lz4", "none")), None, 1, b""
        match dice.randrange(8):
            case 0:
                del parts[at]
            case 1:
                parts[at:at] = [one] * min(dice.choice(DOUBLED), max(LARGE // len(packed(one)), 1))
            case 2:
                dice.shuffle(parts)
            case 3:
                claimed = dice.choice(HUGE)
            case 4:
                repeated = dice.choice(DOUBLED[:2])
                extra = dice.choice((MANY_EMPTY, _odd(dice)))
            case _:
                parts[at] = _changed(one, dice)
        content = packed(*parts) + extra
        return mcap([chunk(content, compression, claimed)] * repeated)


def _odd(dice: Random) -> bytes:
    content = bytes(dice.choice((0, 100, LARGE, 30 * LARGE)))
    return record(dice.randrange(256), content, dice.choice((None, *HUGE)))


def _changed(one: Schema | Channel | Message, dice: Random) -> Schema | Channel | Message:
    if isinstance(one, Message):
        data = retokened(one.data, dice)
        if dice.random() < 0.5:
            data = json.dumps(mutated(json.loads(one.data), dice)).encode()
        return Message(
            dice.choice((one.channel_id, one.channel_id, 0, 1, 65535)), one.log_time, data, dice.choice(HUGE), 0
        )
    name = dice.choice(("", "x" * 100_000, "frame/", "state/left/right", "state/é\x00", "/", "contact/right"))
    if isinstance(one, Channel):
        metadata = dice.choice(({name[:9]: name}, {str(number): "" for number in range(dice.choice((64, 65, MANY)))}))
        return Channel(dice.choice((one.id, 1, 2, 3)), name, "json", metadata, dice.choice((one.schema_id, 9)))
    return Schema(one.id, dice.choice((b"", b"[" * 9000, bytes(LARGE))), "jsonschema", name)


def proto_damaged(content: bytes, dice: Random, depth: int = 0) -> bytes:
    """A protobuf message with one field changed, dropped or repeated; lengths around it are correct."""
    fields = _fields(content)
    if not fields:
        return content + dice.choice(TOKENS)
    at = dice.randrange(len(fields))
    number, kind, value = fields[at]
    if kind == 2 and depth < 6 and dice.random() < 0.8 and (inner := _fields(value)):
        fields[at] = number, kind, proto_damaged(value, dice, depth + 1) if inner else value
    else:
        match dice.randrange(5):
            case 0:
                del fields[at]
            case 1:
                fields[at:at] = [fields[at]] * min(dice.choice(DOUBLED), max(LARGE // (len(value) + 2), 1))
            case 2:
                fields[at] = number, 0, varint(dice.choice(HUGE))
            case 3:
                fields[at] = dice.choice((1, 5, 7, 8, 14, 20, 25, 2**60)), kind, value
            case _ if kind == 2:
                packed_numbers = b"".join(varint(dice.choice(HUGE)) for _ in range(dice.choice((1, 9, 5000))))
                fields[at] = number, 2, dice.choice((b"", value * 2, value[1:], packed_numbers, *TOKENS))
    return b"".join(varint(n << 3 | k) + (varint(len(v)) if k == 2 else b"") + v for n, k, v in fields)


def varint(value: int) -> bytes:
    return bytes([value]) if value < 128 else bytes([value & 127 | 128]) + varint(value >> 7)


def _fields(content: bytes) -> list[tuple[int, int, bytes]]:
    """Number, kind and bytes of each field; [] if it is no message."""
    fields, at = [], 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = content[at]
            at, value, shift = at + 1, value | (byte & 127) << shift, shift + 7
            if byte < 128:
                return value

    try:
        while at < len(content):
            key = number()
            begin = at
            match key & 7:
                case 0:
                    number()
                case 1:
                    at += 8
                case 2:
                    length = number()
                    begin, at = at, at + length
                case 5:
                    at += 4
                case _:
                    return []
            if at > len(content):
                return []
            fields.append((key >> 3, key & 7, content[begin:at]))
    except IndexError:
        return []
    return fields


Remade = Callable[[Random], bytes]
