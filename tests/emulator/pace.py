"""Slows a process's clocks, so that an emulated board slower than the chip seems to run at its full rate."""

from __future__ import annotations

import subprocess
import time


def slowed(pace: float, since_s: float | None = None) -> dict[str, str]:
    """The environment in which `pace` seconds pass in one of ours.

    since_s: time.monotonic() when the slowed clock agreed with ours; None: when the process starts, so that each
    process has another clock. Not through `faketime` itself: it stays the parent, and would get the signal instead of
    the process.
    """
    behind_s = 0.0 if since_s is None else (pace - 1.0) * (time.monotonic() - since_s)
    shown = subprocess.run(
        ["faketime", "-f", f"{behind_s:+.3f} x{pace}", "env"], capture_output=True, text=True, check=True
    )
    lines = shown.stdout.splitlines()
    return dict(line.split("=", 1) for line in lines if line.startswith(("LD_PRELOAD=", "FAKETIME=")))
