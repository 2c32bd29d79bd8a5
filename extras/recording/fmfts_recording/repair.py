"""Gives a recording that was cut off its index and end, for programs that want them (`record --repair`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Schema

from fmfts_recording.file import CopyWriter, RecordingError, is_whole, records


def repair(path: Path, output: Path) -> dict[str, Any]:
    """Write what is readable of `path` into the new file `output`, with an index; returns facts.

    Raises RecordingError: `path` is whole, no recording, damaged or empty, or `output` cannot be written.
    """
    if is_whole(path):
        raise RecordingError(f"{path} is whole: it has its index and end")
    writer = CopyWriter(output)
    try:
        for record in records(path):
            if isinstance(record, (Schema, Channel, Message)):
                writer.copy(record)
        if not writer.messages:
            raise RecordingError(
                f"{path} holds no whole message, up to where it is cut off: there is nothing to repair"
            )
        writer.finish()
    except BaseException:
        writer.discard()
        raise
    writer.close()
    return {"recording": str(output), "messages": writer.messages, "read_from": str(path)}
