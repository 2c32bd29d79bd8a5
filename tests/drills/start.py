"""How long a daemon takes from its start to READY=1 (sd_notify(3)), with a board that is not there: `start.py PYTHON…`.

Each PYTHON has an fmfts of its own, such as that of an older commit; their starts take turns.
"""

from __future__ import annotations

import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STARTS = 15
PATIENCE_S = 60.0
# No board is needed: a service is ready without one, too.
CONFIG = '[[pad]]\nname = "left"\n[pad.source]\ntype = "bridge"\nport = "{folder}/absent"\n'


def ready_after_s(python: str, folder: Path) -> float:
    """Until the daemon has said READY=1."""
    (folder / "config.toml").write_text(CONFIG.format(folder=folder))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(folder / "notify"))
        manager.settimeout(PATIENCE_S)
        environment = {
            **os.environ,
            "NOTIFY_SOCKET": str(folder / "notify"),
            "FMFTS_BUS": f"ipc://{folder}",
            "STATE_DIRECTORY": str(folder / "state"),
        }
        command = [python, "-m", "fmfts", "run", "--config", str(folder / "config.toml")]
        started_s = time.monotonic()
        with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as daemon:
            try:
                while b"READY=1" not in manager.recv(4096):
                    pass
                return time.monotonic() - started_s
            except TimeoutError:
                raise SystemExit(f"{python}: not ready within {PATIENCE_S:.0f} s") from None
            finally:
                daemon.terminate()


def main(pythons: list[str]) -> None:
    taken_s: dict[str, list[float]] = {python: [] for python in pythons}
    for _ in range(STARTS):
        for python, times_s in taken_s.items():
            with tempfile.TemporaryDirectory() as folder:
                times_s.append(ready_after_s(python, Path(folder)))
    for python, times_s in taken_s.items():
        median_s = statistics.median(times_s)
        print(f"{python}: READY after {median_s:.2f} s (median of {STARTS}), {min(times_s):.2f} s at best")


if __name__ == "__main__":
    main(sys.argv[1:] or [sys.executable])
