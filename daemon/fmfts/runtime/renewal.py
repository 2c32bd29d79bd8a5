"""Closes a source that failed, waits, and opens it anew: in another thread, because each of the three may take long."""

from __future__ import annotations

import logging
from collections.abc import Callable
from threading import Event, Thread

from fmfts.runtime.failure import Contained, trace_of
from fmfts.sensor import Source
from fmfts.service.realtime import take_thread_priority, thread_priority

log = logging.getLogger(__name__)

CLOSING_S = 1.0  # as long as a source may take to close


class Renewal:
    """failed: the source to close, None if there is none to close. pause_s: from closing it to opening another."""

    def __init__(self, failed: Source | None, pause_s: float, open_device: Callable[[], Source]) -> None:
        self._failed = failed
        self._pause_s = pause_s
        self._open_device = open_device
        # An ordinary thread that waits for a processor with the interpreter's lock would hold up the loop.
        self._priority = thread_priority()
        self._cancelled = Event()
        self._device: Source | None = None
        self._error: BaseException | None = None
        # The program may end while this thread waits for a device.
        self._thread = Thread(target=self._run, name="renewal", daemon=True)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        return not self._thread.is_alive()

    def result(self) -> Source:
        """The new source. Raises what its constructor raised."""
        if self._device is None:
            raise self._error or RuntimeError("no source was opened")
        return self._device

    def cancel(self) -> None:
        """Open nothing more, and close what is open."""
        self._cancelled.set()
        self._thread.join(CLOSING_S)
        if self._device is not None:
            close(self._device)

    def _run(self) -> None:
        try:
            if self._priority:
                take_thread_priority(self._priority)
            if self._failed is not None:
                close(self._failed)
            if self._cancelled.wait(self._pause_s):
                return
            self._device = self._open_device()
        except BaseException as error:  # noqa: BLE001 - `result` raises it
            self._error = error


def close(source: Source) -> None:
    """Close a source, whatever it raises then."""
    text = "%s: closing it failed, and its device may still be open\n%s"
    with Contained(lambda error: log.error(text, type(source).__name__, trace_of(error))):
        source.close()
