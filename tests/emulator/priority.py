"""Emulated hardware is not late because the computer that emulates it is busy."""

from __future__ import annotations

import os
from contextlib import suppress

AHEAD = -15


def put_ahead(native_id: int = 0) -> None:
    """This thread, or that process, before others; where this user may not, all stay as they are."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, native_id, AHEAD)
