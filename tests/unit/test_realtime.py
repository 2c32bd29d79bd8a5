"""What `[service]` of the configuration asks of the system, in a process of its own: it cannot be taken back."""

from __future__ import annotations

import subprocess
import sys

import pytest

import permitted

PRIORITY = """
import os, threading, zmq
from fmfts.service.realtime import take_priority
zmq.Context.instance().socket(zmq.PUB)
take_priority(3)
policies = []
for task in os.listdir("/proc/self/task"):
    if open(f"/proc/self/task/{task}/comm").read().startswith("ZMQbg"):
        policies.append(os.sched_getscheduler(int(task)) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO)
seen = []
thread = threading.Thread(target=lambda: seen.append(os.sched_getscheduler(0)))
thread.start()
thread.join()
policy = os.sched_getscheduler(0)
print(policies == [True, True], policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO, seen[0] == os.SCHED_OTHER)
"""
LOCKED = """
from fmfts.service.realtime import lock_memory
lock_memory()
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmLck")))
"""


DENIED = """
import os, resource
from fmfts.service.realtime import RealtimeError, lock_memory, take_priority
resource.setrlimit(resource.{limit}, ({kept}, {kept}))
os.setuid(65534)  # root is above limits
try:
    {call}
except RealtimeError as error:
    print(error)
"""


def in_a_process(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    return done.stdout.strip() or done.stderr.strip()


@pytest.mark.skipif(not permitted.priority(), reason=permitted.NO_PRIORITY)
def test_loop_and_bus_come_first_and_what_they_start_does_not() -> None:
    assert in_a_process(PRIORITY) == "True True True"


@pytest.mark.skipif(not permitted.locked_memory(), reason=permitted.NO_LOCKED_MEMORY)
def test_memory_stays() -> None:
    assert int(in_a_process(LOCKED)) > 1000  # kB


@pytest.mark.skipif(not permitted.another_user(), reason="needs root, to give it up")
def test_what_is_not_permitted_is_said_with_what_to_grant() -> None:
    priority = in_a_process(DENIED.format(limit="RLIMIT_RTPRIO", kept=0, call="take_priority(7)"))
    assert "LimitRTPRIO=7" in priority
    assert "CAP_SYS_NICE" in priority


@pytest.mark.skipif(not permitted.another_user(), reason="needs root, to give it up")
@pytest.mark.parametrize(("kept", "said"), [(0, "no memory may"), (65536, "only 64 kB of memory may")])
def test_memory_that_may_not_be_locked_is_said_with_what_to_grant(kept: int, said: str) -> None:
    memory = in_a_process(DENIED.format(limit="RLIMIT_MEMLOCK", kept=kept, call="lock_memory()"))
    assert memory.startswith(f"service.lock_memory: {said} be locked here")
    assert "LimitMEMLOCK=infinity" in memory
    assert "CAP_IPC_LOCK" in memory
