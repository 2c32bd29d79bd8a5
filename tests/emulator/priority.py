"""Emulated hardware must not be late because the emulating computer is busy."""

from __future__ import annotations

import os
from contextlib import suppress

AHEAD = -15


def put_ahead(native_id: int = 0) -> None:
    """Give this thread, or that process, priority; without permission all stay as they are."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, native_id, AHEAD)
