"""What the system permits to the tests' user: containers and ordinary users may do less than root."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from functools import cache
from pathlib import Path

CAP_IPC_LOCK = 14  # <linux/capability.h>
NO_PRIORITY = "SCHED_FIFO is not permitted here: ulimit -r, or root; in a container CAP_SYS_NICE"
NO_LOCKED_MEMORY = "locked memory is limited here: ulimit -l unlimited, or root; in a container CAP_IPC_LOCK"


@cache
def priority() -> bool:
    code = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(3))"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def locked_memory() -> bool:
    """As much as a process wants."""
    (effective,) = re.findall(r"CapEff:\s*(\w+)", Path("/proc/self/status").read_text())
    unlimited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY
    return unlimited or bool(int(effective, 16) >> CAP_IPC_LOCK & 1)


def another_user() -> bool:
    """To become one."""
    return os.geteuid() == 0
