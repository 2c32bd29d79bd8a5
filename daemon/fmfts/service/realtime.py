"""Gives the daemon real-time priority (SCHED_FIFO) and locks its memory, where the configuration asks for it."""

from __future__ import annotations

import ctypes
import errno
import logging
import os
import platform
import resource
import struct
import threading
import time
from pathlib import Path

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4  # <sys/mman.h>
TASKS = Path("/proc/self/task")
BUS_THREAD = "ZMQbg"  # libzmq's name for its threads, which send the messages and so need the priority too
BUS_THREADS = 2  # the reaper, and one for the sockets
SCHED_SETATTR = {"x86_64": 314, "aarch64": 274, "riscv64": 274, "armv7l": 380}  # numbers of the system call
SLICE_NS = 100_000  # the shortest that Linux grants; a frame takes half as long
NAMED_WITHIN_S = 5.0  # each thread names itself when it first runs; on a busy computer that takes a while
DEFAULT_PRIORITY = "FMFTS_REALTIME_PRIORITY"  # set in the service's unit

log = logging.getLogger(__name__)


class RealtimeError(Exception):
    """The system does not permit real-time priority or locked memory; the text says what to grant."""


def lock_memory() -> None:
    """Keep every page of this process in memory from its first use on, also future ones (mlockall(2)).

    Unused pages, such as the rest of a thread's stack, take no memory. Raises RealtimeError.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0:
        why = _why_not_locked(ctypes.get_errno())
        raise RealtimeError(
            f"service.lock_memory: {why}: grant it (a service: LimitMEMLOCK=infinity; a shell: ulimit -l unlimited; "
            "a container: its CAP_IPC_LOCK), or set it to false"
        )


def memory_is_locked() -> bool:
    """Whether pages of this process are locked in memory (proc(5), VmLck)."""
    status = Path("/proc/self/status").read_text()
    return any(line.startswith("VmLck:") and int(line.split()[1]) > 0 for line in status.splitlines())


def _why_not_locked(code: int) -> str:
    """The reason in words. ENOMEM means that the limit is too low, not that memory is short (mlock(2))."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if code not in (errno.ENOMEM, errno.EPERM) or limit == resource.RLIM_INFINITY:
        return os.strerror(code)
    return f"only {limit // 1024} kB of memory may be locked here" if limit else "no memory may be locked here"


def take_default_priority() -> None:
    """Take the priority that the service's unit gives in FMFTS_REALTIME_PRIORITY; log a refusal.

    It is no error: without it the daemon drops frames on a busy computer, and reports that.
    """
    given = default_priority()
    if given == 0:
        return
    try:
        take_priority(given)
    except RealtimeError as error:
        log.warning("an ordinary process: other programs that are busy will make it leave frames out: %s", error)
    else:
        log.info("runs before every ordinary process: SCHED_FIFO %d", given)


def default_priority() -> int:
    """The priority that the service's unit gives; 0: none."""
    given = os.environ.get(DEFAULT_PRIORITY, "")
    return int(given) if given.isdecimal() else 0


def take_priority(priority: int) -> None:
    """Run this thread and libzmq's before all normal processes (sched(7)). Threads started later are not included.

    Raises RealtimeError.
    """
    take_thread_priority(priority)
    until = time.monotonic() + NAMED_WITHIN_S
    while len(threads := _bus_threads()) < BUS_THREADS:
        if time.monotonic() > until:
            raise RealtimeError(
                f"service.realtime_priority = {priority}: this process has no threads named {BUS_THREAD}…: this libzmq "
                "was built without thread names, so its threads cannot get the priority; set it to 0"
            )
        time.sleep(1e-3)
    for thread in threads:
        _set_priority(thread, priority)


def ask_for_short_slices() -> bool:
    """Ask to run for shorter times, and so sooner after waking, at an ordinary process's share (sched(7), EEVDF).

    For this thread and libzmq's. Linux before 6.12 ignores it. False if it was refused, which costs only latency.
    """
    number = SCHED_SETATTR.get(platform.machine())
    if number is None:
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    attributes = struct.pack("=IIQiIQQQ", 48, os.SCHED_OTHER, 0, nice, 0, SLICE_NS, 0, 0)
    threads = [threading.get_native_id(), *_bus_threads()]
    return all(libc.syscall(number, thread, attributes, 0) == 0 for thread in threads)


def take_thread_priority(priority: int) -> None:
    """Like `take_priority`, for this thread alone. Raises RealtimeError."""
    _set_priority(threading.get_native_id(), priority)


def thread_priority() -> int:
    """Real-time priority of the calling thread, 1 to 99; 0: a normal thread."""
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
