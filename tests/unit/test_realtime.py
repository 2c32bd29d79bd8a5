"""What `[service]` of the configuration asks of the system, in a process of its own: it cannot be taken back."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

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


BY_DEFAULT = """
import logging, os, resource, zmq
from fmfts.service.realtime import take_default_priority
logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
zmq.Context.instance().socket(zmq.PUB)
if {denied}:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    os.setuid(65534)  # root is above limits
os.environ |= {environ}
take_default_priority()
print(os.sched_getparam(0).sched_priority)
"""
UNIT = Path(__file__).parents[2] / "systemd" / "fmfts.service"


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
def test_only_loop_and_bus_have_priority() -> None:
    assert in_a_process(PRIORITY) == "True True True"


def with_default(priority: str, denied: bool) -> tuple[str, str]:
    """The priority and the log of a process whose unit gives this priority."""
    code = BY_DEFAULT.format(denied=denied, environ={"FMFTS_REALTIME_PRIORITY": priority} if priority else {})
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.strip(), done.stderr


@pytest.mark.skipif(not permitted.priority(), reason=permitted.NO_PRIORITY)
def test_service_comes_first_by_default_and_says_so() -> None:
    (given,) = re.findall(r"^Environment=FMFTS_REALTIME_PRIORITY=(\d+)$", UNIT.read_text(), re.M)
    priority, log = with_default(given, denied=False)
    assert priority == given
    assert "runs before every ordinary process" in log
    assert with_default("", denied=False) == with_default("0", denied=False) == ("0", "")


@pytest.mark.skipif(not permitted.another_user(), reason="needs root, to give it up")
def test_service_without_realtime_priority_says_so_and_goes_on() -> None:
    priority, log = with_default("10", denied=True)
    assert priority == "0"
    assert "WARNING an ordinary process: other programs that are busy will make it leave frames out" in log
    assert "LimitRTPRIO=10" in log


@pytest.mark.skipif(not permitted.locked_memory(), reason=permitted.NO_LOCKED_MEMORY)
def test_memory_is_locked() -> None:
    assert int(in_a_process(LOCKED)) > 1000  # kB


@pytest.mark.skipif(not permitted.another_user(), reason="needs root, to give it up")
def test_missing_permission_is_reported_with_what_to_grant() -> None:
    priority = in_a_process(DENIED.format(limit="RLIMIT_RTPRIO", kept=0, call="take_priority(7)"))
    assert "LimitRTPRIO=7" in priority
    assert "CAP_SYS_NICE" in priority


@pytest.mark.skipif(not permitted.another_user(), reason="needs root, to give it up")
@pytest.mark.parametrize(("kept", "said"), [(0, "no memory may"), (65536, "only 64 kB of memory may")])
def test_memory_that_may_not_be_locked_is_reported_with_what_to_grant(kept: int, said: str) -> None:
    memory = in_a_process(DENIED.format(limit="RLIMIT_MEMLOCK", kept=kept, call="lock_memory()"))
    assert memory.startswith(f"service.lock_memory: {said} be locked here")
    assert "LimitMEMLOCK=infinity" in memory
    assert "CAP_IPC_LOCK" in memory
