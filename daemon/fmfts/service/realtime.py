"""Before everything else on this computer, where the configuration asks for it: SCHED_FIFO, and memory that stays."""

from __future__ import annotations

import ctypes
import errno
import os
import resource
import threading
import time
from pathlib import Path

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4  # <sys/mman.h>
TASKS = Path("/proc/self/task")
BUS_THREAD = "ZMQbg"  # what libzmq calls its threads: without them a message waits after all
BUS_THREADS = 2  # the reaper, and one for the sockets
NAMED_WITHIN_S = 5.0  # a thread gives itself its name, on a busy computer only after a while


class RealtimeError(Exception):
    """The system does not permit it; the text says what to grant."""


def lock_memory() -> None:
    """No page that was touched is ever swapped out, nor are those to come (mlockall(2)).

    Untouched pages, such as the rest of a thread's stack, take no memory. Raises RealtimeError.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0:
        why = _why_not_locked(ctypes.get_errno())
        raise RealtimeError(
            f"service.lock_memory: {why}: grant it (a service: LimitMEMLOCK=infinity; a shell: ulimit -l unlimited; "
            "a container: its CAP_IPC_LOCK), or set it to false"
        )


def _why_not_locked(code: int) -> str:
    """ENOMEM is a limit that is too low (mlock(2)): the computer's memory may be almost empty."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if code not in (errno.ENOMEM, errno.EPERM) or limit == resource.RLIM_INFINITY:
        return os.strerror(code)
    return f"only {limit // 1024} kB of memory may be locked here" if limit else "no memory may be locked here"


def take_priority(priority: int) -> None:
    """This thread and the bus's run before every normal process (sched(7)); what they start later does not.

    Raises RealtimeError.
    """
    take_thread_priority(priority)
    until = time.monotonic() + NAMED_WITHIN_S
    while len(threads := _bus_threads()) < BUS_THREADS:
        if time.monotonic() > until:
            raise RealtimeError(
                f"service.realtime_priority = {priority}: the bus's threads ({BUS_THREAD}…) were not found among this "
                "process's: libzmq was built without their names; set it to 0"
            )
        time.sleep(1e-3)
    for thread in threads:
        _set_priority(thread, priority)


def take_thread_priority(priority: int) -> None:
    """This thread alone, as `take_priority`. Raises RealtimeError."""
    _set_priority(threading.get_native_id(), priority)


def thread_priority() -> int:
    """Of the thread that asks, 1 to 99; 0: an ordinary one."""
    return os.sched_getparam(0).sched_priority


def _bus_threads() -> list[int]:
    return [int(task.name) for task in TASKS.iterdir() if (task / "comm").read_text().startswith(BUS_THREAD)]


def _set_priority(thread: int, priority: int) -> None:
    try:
        os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        if error.errno != errno.EPERM:
            raise RealtimeError(f"service.realtime_priority = {priority}: {error.strerror}") from error
        raise RealtimeError(
            f"service.realtime_priority = {priority}: not permitted: grant it (a service: LimitRTPRIO={priority}; "
            "a shell: ulimit -r; a container: its CAP_SYS_NICE), or set it to 0"
        ) from error
