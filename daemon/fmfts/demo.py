"""`make demo`: the daemon and a live listener in one terminal, on sockets and state of their own."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fmfts_client.endpoints import OVERRIDE

START_S = 20.0
STOP_S = 5.0


@contextmanager
def running_daemon(config: Path, folder: Path) -> Iterator[str]:
    """`fmfts-daemon run` as its own process, with sockets, state and log in `folder`; yields the base of its endpoints.

    SystemExit, after its log, where it does not start.
    """
    base = f"ipc://{folder}"
    environment = os.environ | {OVERRIDE: base, "XDG_STATE_HOME": str(folder / "state")}
    log = folder / "daemon.log"
    with log.open("w") as stderr:
        command = [sys.executable, "-m", "fmfts", "run", "--config", str(config)]
        daemon = subprocess.Popen(command, stderr=stderr, env=environment)
        try:
            _wait_for(folder / "bus", daemon, log)
            yield base
        finally:
            daemon.send_signal(signal.SIGTERM)
            try:
                daemon.wait(STOP_S)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def _wait_for(socket: Path, daemon: subprocess.Popen[bytes], log: Path) -> None:
    until = time.monotonic() + START_S
    while not socket.exists():
        if daemon.poll() is not None or time.monotonic() > until:
            sys.stderr.write(log.read_text())
            raise SystemExit(daemon.returncode or 1)
        time.sleep(0.02)


def main() -> int:
    from fmfts.view.listen import listen

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--seconds", type=float)
    options = parser.parse_args()
    with (
        tempfile.TemporaryDirectory(prefix="fmfts-demo-") as folder,
        running_daemon(options.config, Path(folder)) as base,
    ):
        return listen(None, options.seconds, endpoint=base)


if __name__ == "__main__":
    # Ctrl-C reaches the daemon too, in its own way; the listener ends it with the summary.
    raise SystemExit(main())
