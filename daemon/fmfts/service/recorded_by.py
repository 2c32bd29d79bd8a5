"""The configuration file that recorded a pad's kept state, which all pads of that name share."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import msgspec

from fmfts.service.state import write_atomically


class _Dated(msgspec.Struct):
    utc: str


class _Kept(msgspec.Struct):
    """The dates of a baseline or self-test, of whatever geometry and board."""

    bare: _Dated | None = None
    rest: _Dated | None = None
    gains: _Dated | None = None


_in_use: list[Path] = []  # at most one: this process's configuration


def use(configuration: Path) -> None:
    """Name the configuration file of this process."""
    _in_use[:] = [configuration.resolve()]


def sign(state: Path, signature: bytes | None = None) -> None:
    """Keep beside a file of state which configuration recorded it. A failure only makes a later warning shorter.

    signature: of the file that `state` is a copy of; None: this process recorded it.
    """
    if signature is None:
        signature = f"{_in_use[0]}\n".encode(errors="surrogateescape") if _in_use else b""
    with suppress(OSError):
        if signature:
            write_atomically(_signature_file_of(state), signature)
        else:
            _signature_file_of(state).unlink(missing_ok=True)


def signature_of(state: Path) -> bytes:
    """Empty if nothing says which configuration recorded it."""
    return _content_of(_signature_file_of(state))


def foreign(state: Path, kind: str, verb: str = "replaces") -> list[str]:
    """A warning before `state` is written, if another configuration recorded what is there. kind: a word for it."""
    signer = signature_of(state).decode(errors="surrogateescape").rstrip("\n")
    if not _in_use or signer == str(_in_use[0]):
        return []
    try:
        kept = msgspec.json.decode(_content_of(state), type=_Kept)
    except (ValueError, RecursionError):  # there is none, or it is damaged
        return []
    dated = kept.rest or kept.bare or kept.gains
    if dated is None:
        return []
    what = f"{verb} the {kind} of {dated.utc}"
    if not signer:
        return [what]
    return [f"{what} that {signer} recorded: rename one of the two pads, or set XDG_STATE_HOME to keep both"]


def _signature_file_of(state: Path) -> Path:
    return state.with_suffix(".config")


def _content_of(path: Path) -> bytes:
    """Empty for what cannot be read."""
    with suppress(OSError):
        if path.is_file():
            return path.read_bytes()
    return b""
