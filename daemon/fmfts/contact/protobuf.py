"""Protobuf's wire format (https://protobuf.dev/programming-guides/encoding): numbered fields, integers or bytes."""

from __future__ import annotations

from collections.abc import Iterator

Value = int | bytes
MOST_PARTS = 100_000  # fields and numbers, in all messages of a file; contact/default.onnx has 600


class MalformedError(ValueError):
    """The bytes are not a protobuf message."""


class Budget:
    """What reading a file may cost. Each part takes one from `left`."""

    def __init__(self, left: int = MOST_PARTS) -> None:
        self.left = left

    def spend(self) -> None:
        """MalformedError where nothing is left."""
        self.left -= 1
        if self.left < 0:
            raise MalformedError("it has more parts than any contact model")


class Message:
    """The fields of a message, by number. MalformedError if `content` is not a message, or has too many parts.

    As in protobuf, a field that is absent or of another kind reads as empty or zero. Messages within share its budget.
    """

    def __init__(self, content: bytes, budget: Budget | None = None) -> None:
        self._values: dict[int, list[Value]] = {}
        self.budget = Budget() if budget is None else budget
        for number, value in _fields(content):
            self.budget.spend()
            self._values.setdefault(number, []).append(value)

    def __contains__(self, number: int) -> bool:
        return number in self._values

    def parts(self, number: int) -> list[bytes]:
        return [value for value in self._values.get(number, []) if isinstance(value, bytes)]

    def part(self, number: int) -> bytes:
        parts = self.parts(number)
        return parts[-1] if parts else b""

    def messages(self, number: int) -> list[Message]:
        return [Message(part, self.budget) for part in self.parts(number)]

    def message(self, number: int) -> Message:
        return Message(self.part(number), self.budget)

    def texts(self, number: int) -> list[str]:
        return [_text(part) for part in self.parts(number)]

    def text(self, number: int) -> str:
        return _text(self.part(number))

    def integers(self, number: int) -> list[int]:
        """All integers in a repeated field, packed or not; unsigned."""
        integers: list[int] = []
        for value in self._values.get(number, []):
            if isinstance(value, int):
                integers.append(value)
                continue
            position = 0
            while position < len(value):
                self.budget.spend()
                one, position = _varint(value, position)
                integers.append(one)
        return integers

    def integer(self, number: int) -> int:
        values = [value for value in self._values.get(number, []) if isinstance(value, int)]
        return values[-1] if values else 0


def _text(part: bytes) -> str:
    try:
        return part.decode()
    except UnicodeDecodeError:
        raise MalformedError("a text in it is not UTF-8") from None


def _fields(content: bytes) -> Iterator[tuple[int, Value]]:
    position = 0
    while position < len(content):
        key, position = _varint(content, position)
        if key >> 32:  # other readers keep its lowest 32 bits only, and find another field
            raise MalformedError("a field's number has more than 32 bits")
        match key & 7:
            case 0:
                value, position = _varint(content, position)
                yield key >> 3, value
                continue
            case 1:
                size = 8
            case 2:
                size, position = _varint(content, position)
            case 5:
                size = 4
            case kind:
                raise MalformedError(f"a field is of the unknown kind {kind}")
        if position + size > len(content):
            raise MalformedError("it ends within a field")
        yield key >> 3, content[position : position + size]
        position += size


def _varint(content: bytes, position: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if position >= len(content):
            raise MalformedError("it ends within a number")
        byte = content[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
    raise MalformedError("a number in it is longer than 64 bits")
