"""`make demo`: the daemon and a live listener in one terminal, on sockets and state of their own."""

# What takes long to import is imported in `main`, where Ctrl-C is waited for.
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

START_S = 20.0
STOP_S = 5.0
LAST_LINES = 20
ENDING = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


@contextmanager
def running_daemon(config: Path, folder: Path) -> Iterator[str]:
    """`fmfts-daemon run` as its own process, with sockets, state and log in `folder`; yields the base of its endpoints.

    Ctrl-C is left to the caller, who gets a KeyboardInterrupt also when the daemon ends by itself. SystemExit, after
    the end of its log, where it did, or did not start.
    """
    from fmfts_client.endpoints import OVERRIDE

    base = f"ipc://{folder}"
    environment = os.environ | {OVERRIDE: base, "XDG_STATE_HOME": str(folder / "state")}
    log = folder / "daemon.log"
    command = [sys.executable, "-m", "fmfts", "run", "--config", str(config)]
    serving = False
    with log.open("w") as stderr:
        # A signal between fork and `try` would leave the daemon behind.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        daemon = subprocess.Popen(command, stderr=stderr, env=environment, preexec_fn=_ignore_ctrl_c)
        try:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            serving = _is_serving(folder / "bus", daemon)
            if serving:
                with _interrupted_by_the_end_of(daemon):
                    yield base
        finally:
            ended = daemon.poll()
            _stop(daemon)
            if ended is not None or (not serving and sys.exc_info()[0] is None):
                _explain(log, ended)


def _ignore_ctrl_c() -> None:
    """In the daemon: Ctrl-C reaches every process of a terminal, and the listener ends this one with SIGTERM."""
    signal.pthread_sigmask(signal.SIG_SETMASK, {signal.SIGINT})


def _is_serving(socket: Path, daemon: subprocess.Popen[bytes]) -> bool:
    until = time.monotonic() + START_S
    while not socket.exists():
        if daemon.poll() is not None or time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


@contextmanager
def _interrupted_by_the_end_of(daemon: subprocess.Popen[bytes]) -> Iterator[None]:
    def interrupt(*_: object) -> None:
        if daemon.poll() is not None:  # it may have been stopped (Ctrl-Z) only
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGCHLD, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGCHLD, before)


def _stop(daemon: subprocess.Popen[bytes]) -> None:
    daemon.terminate()
    try:
        daemon.wait(STOP_S)
    except subprocess.TimeoutExpired:
        daemon.kill()
        daemon.wait()


def _explain(log: Path, code: int | None) -> None:
    """The log is in a folder that is about to go."""
    what = f"did not serve within {START_S:g} s" if code is None else f"ended with {code}"
    lines = log.read_text().splitlines()[-LAST_LINES:]
    print(f"fmfts-daemon {what}; the end of its log:", *lines, sep="\n", file=sys.stderr)
    raise SystemExit(max(code or 1, 1))


def end_on_signals() -> None:
    """From here on there is something to clear up. Ctrl-C may be ignored: make's shell passes it on as SIGTERM."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--seconds", type=float)
    options = parser.parse_args()
    from fmfts.view.listen import listen

    end_on_signals()
    with (
        tempfile.TemporaryDirectory(prefix="fmfts-demo-") as folder,
        running_daemon(options.config, Path(folder)) as base,
    ):
        return listen(None, options.seconds, endpoint=base)


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except KeyboardInterrupt:
        raise SystemExit(0) from None
