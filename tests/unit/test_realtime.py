"""What `[service]` of the configuration asks of the system, in a process of its own: it cannot be taken back."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

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
resource.setrlimit(resource.{limit}, (0, 0))
os.setuid(65534)  # root is above limits
try:
    {call}
except RealtimeError as error:
    print(error)
"""


def in_a_process(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    return done.stdout.strip() or done.stderr.strip()


def is_permitted() -> bool:
    return os.geteuid() == 0


@pytest.mark.skipif(not is_permitted(), reason="needs root")
def test_loop_and_bus_come_first_and_what_they_start_does_not() -> None:
    assert in_a_process(PRIORITY) == "True True True"


@pytest.mark.skipif(not is_permitted(), reason="needs root")
def test_memory_stays() -> None:
    assert int(in_a_process(LOCKED)) > 1000  # kB


@pytest.mark.skipif(not is_permitted(), reason="needs root, to give it up")
def test_what_is_not_permitted_is_said_with_what_to_grant() -> None:
    assert "LimitRTPRIO=7" in in_a_process(DENIED.format(limit="RLIMIT_RTPRIO", call="take_priority(7)"))
    assert "LimitMEMLOCK=infinity" in in_a_process(DENIED.format(limit="RLIMIT_MEMLOCK", call="lock_memory()"))
