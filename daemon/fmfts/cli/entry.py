"""The command `fmfts-daemon`. Importing the verbs takes a while, and Ctrl-C ends that without a traceback, too."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

INTERRUPTED = 130  # as in common/exit_codes.py, which is imported later


def main() -> int:
    """Run the command and return its exit code. Ctrl-C before and after the verb ends the process at once."""
    # Matrices here are small: another thread of OpenBLAS would only wait for this one, on a core that it keeps busy.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # except where a shell ignores it
    if interruptible:
        signal.signal(signal.SIGINT, _end)
    try:
        from fmfts.cli.main import main as run

        if interruptible:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return run()
    except KeyboardInterrupt:  # before a verb ran
        return INTERRUPTED
    finally:
        if interruptible:
            signal.signal(signal.SIGINT, _end)  # at exit Python would print "Exception ignored in …"


def _end(*_: object) -> None:
    with suppress(OSError, RuntimeError):  # its reader is gone, or this signal interrupted another flush
        sys.stdout.flush()
    os._exit(INTERRUPTED)
