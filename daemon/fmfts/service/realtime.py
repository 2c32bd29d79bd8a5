"""Before everything else on this computer, where the configuration asks for it: SCHED_FIFO, and memory that stays."""

from __future__ import annotations

import ctypes
import errno
import os
from pathlib import Path

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4  # <sys/mman.h>
TASKS = Path("/proc/self/task")
BUS_THREAD = "ZMQbg"  # what libzmq calls its threads: without them a message waits after all


class RealtimeError(Exception):
    """The system does not permit it; the text says what to grant."""


def lock_memory() -> None:
    """No page that was touched is ever swapped out, nor are those to come (mlockall(2)).

    Untouched pages, such as the rest of a thread's stack, take no memory. Raises RealtimeError.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0:
        code = ctypes.get_errno()
        raise RealtimeError(
            f"service.lock_memory: {os.strerror(code)}: grant it (a service: LimitMEMLOCK=infinity; a shell: "
            "ulimit -l unlimited), or set it to false"
        )


def take_priority(priority: int) -> None:
    """This thread and the bus's run before every normal process (sched(7)); what they start later does not.

    Raises RealtimeError.
    """
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    for task in TASKS.iterdir():
        if int(task.name) != os.getpid() and not (task / "comm").read_text().startswith(BUS_THREAD):
            continue
        try:
            os.sched_setscheduler(int(task.name), policy, os.sched_param(priority))
        except OSError as error:
            if error.errno != errno.EPERM:
                raise RealtimeError(f"service.realtime_priority = {priority}: {error.strerror}") from error
            raise RealtimeError(
                f"service.realtime_priority = {priority}: not permitted: grant it (a service: LimitRTPRIO={priority}; "
                "a shell: ulimit -r), or set it to 0"
            ) from error
