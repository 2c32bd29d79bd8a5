"""Confines unexpected errors, so that one pad's work cannot end the daemon or another pad's work."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from types import TracebackType

LONGEST_TEXT = 200
DEEPEST_CALLS = 12  # calls of a traceback: a RecursionError's thousand take as long as three frames


class Contained:
    """Within this context, `handle` gets whatever is raised, but for KeyboardInterrupt and what `passes` names.

    Also SystemExit and MemoryError are handled: a library that ends the process would end the other pads, too.
    """

    __slots__ = "_handle", "_passes"

    def __init__(self, handle: Callable[[BaseException], None], *passes: type[BaseException]) -> None:
        self._handle = handle
        self._passes: tuple[type[BaseException], ...] = (KeyboardInterrupt, *passes)

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if error is None or isinstance(error, self._passes):
            return False
        self._handle(error)
        return True


def sentence_of(error: BaseException) -> str:
    """Kind and text of an error, in one short line that a message can carry."""
    text = text_of(error)
    short = text if len(text) <= LONGEST_TEXT else f"{text[: LONGEST_TEXT - 1]}…"
    return f"{type(error).__name__}: {short}" if short else type(error).__name__


def text_of(error: BaseException) -> str:
    """The text of an error in one line that a message can carry, whatever it is."""
    try:
        text = " ".join(str(error).split())
    except Exception as again:  # noqa: BLE001 - making the text of an error may raise another one
        text = f"its text cannot be shown, {type(again).__name__}"
    return _encodable(text)


def trace_of(error: BaseException) -> str:
    """The traceback for the log, with the deepest calls only."""
    return _encodable("".join(traceback.format_exception(error, limit=-DEEPEST_CALLS)).rstrip())


def _encodable(text: str) -> str:
    """Without the lone surrogates of a file name that is no UTF-8: messages and logs cannot hold them."""
    return text.encode("utf-8", "backslashreplace").decode()
