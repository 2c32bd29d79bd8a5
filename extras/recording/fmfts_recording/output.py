"""Writes an MCAP file whose written part survives: each chunk is passed to the system, and errors are reported."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from fmfts.common.writing import why_not_written

CHUNK_BYTES = 1 << 20


class RecordingError(Exception):
    """A recording cannot be written or read; the text names the file, why, and what to do."""


class NotWrittenError(RecordingError):
    """A recording cannot be written."""


class McapFile:
    """A new file. Raises NotWrittenError where it exists already, or cannot be made.

    writer: of the mcap package, typed by the used methods. Use it within `disk`, which names the file in errors.
    """

    def __init__(self, path: Path, profile: str) -> None:
        self.path = path
        self.messages = 0
        try:
            self._output = _Output(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640))
            self.writer: Any = Writer(
                cast(IO[bytes], self._output), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD
            )
            self.writer.start(profile)
            self.flush()
        except FileExistsError as error:
            raise NotWrittenError(
                f"{path}: {error.strerror}: a recording is never overwritten; give another name"
            ) from error
        except OSError as error:
            raise NotWrittenError(f"{path}: {why_not_written(error)}") from error

    def flush(self) -> None:
        """End the chunk: its messages survive the end of this process. NotWrittenError: the disk is full."""
        with self.disk():
            self.writer.flush()

    def sync(self) -> None:
        """Like flush, but the messages also survive a power cut."""
        self.flush()
        with self.disk():
            self._output.sync()

    def finish(self) -> None:
        """Write the index, and end the file. A file without an index can be read too."""
        with self.disk():
            self.writer.finish()
            self._output.sync()

    def attach(self, name: str, json: bytes) -> None:
        """Write a file of JSON beside the messages."""
        now_ns = time.time_ns()
        with self.disk():
            self.writer.add_attachment(now_ns, now_ns, name, "application/json", json)

    def discard(self) -> None:
        """Close and delete the file."""
        self.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        self._output.close()

    @contextmanager
    def disk(self) -> Iterator[None]:
        """Turns the disk's errors into NotWrittenError."""
        try:
            yield
        except OSError as error:
            raise NotWrittenError(
                f"{self.path}: {why_not_written(error)}; the messages before can be read from it"
            ) from error


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
