"""A process's clocks slowed, so that an emulated board that takes longer than the chip runs at its full rate to it."""

from __future__ import annotations

import subprocess


def slowed(pace: float) -> dict[str, str]:
    """The environment in which `pace` seconds pass in one of ours. Not through `faketime` itself: it stays the parent,
    and would be told to end in place of the process."""
    shown = subprocess.run(["faketime", "-f", f"+0 x{pace}", "env"], capture_output=True, text=True, check=True)
    lines = shown.stdout.splitlines()
    return dict(line.split("=", 1) for line in lines if line.startswith(("LD_PRELOAD=", "FAKETIME=")))
