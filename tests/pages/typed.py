"""Types the commands of a page in its order, in a folder of its own, on a simulated pad."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pages.commands import ROOT

BY_ITSELF = re.compile(r"fmfts-daemon (run|view)\b")  # goes on until it is interrupted
PATIENCE_S, BEGINS_S, ENDS_S = 600.0, 60.0, 30.0
ENDED_BY_US = (0, 130, -signal.SIGINT)


def printed(begun: subprocess.Popen[str], within_s: float, command: str) -> tuple[str, str]:
    """The command's output. If it does not end in time, it and its children are killed, with an AssertionError."""
    try:
        return begun.communicate(timeout=within_s)
    except subprocess.TimeoutExpired as error:
        said = b"".join(filter(None, (error.stdout, error.stderr))).decode()
        raise AssertionError(f"{command}: did not end within {within_s:.0f} s; it printed {said!r}") from None
    finally:
        with begun, suppress(ProcessLookupError):  # the command may have ended, but not its children
            os.killpg(begun.pid, signal.SIGKILL)


class Reader:
    """A person who types, in `folder`. Programs that run on are left running until `leave`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._left_running: list[tuple[str, subprocess.Popen[str]]] = []
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        homes = {name: f"{folder}/{name.lower()}" for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")}
        homes |= {"HOME": str(folder), "CLONE": str(ROOT)}
        self._environment = os.environ | homes | {"PATH": path, "FMFTS_BUS": f"ipc://{folder}"}
        for name in ("config.toml", "docs"):
            if not (folder / name).exists():
                (folder / name).symlink_to(ROOT / name)

    def type(self, command: str) -> str:
        """The output; AssertionError if the command fails, or ends although it should run on."""
        begun = subprocess.Popen(
            ["bash", "-c", f"exec {command}" if BY_ITSELF.search(command) else command],
            cwd=self.folder, env=self._environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        if BY_ITSELF.search(command):
            self._left_running.append((command, begun))
            self._begins(command, begun)
            return ""
        said, errors = printed(begun, PATIENCE_S, command)
        assert begun.returncode == 0, (command, begun.returncode, said, errors)
        assert "Traceback" not in errors, (command, errors)
        return said + errors

    def _begins(self, command: str, begun: subprocess.Popen[str]) -> None:
        until = time.monotonic() + BEGINS_S
        while " run" in command and not (self.folder / "control").exists() and begun.poll() is None:
            assert time.monotonic() < until, f"{command}: no control socket"
            time.sleep(0.05)
        time.sleep(2.0)  # `status` describes a second, and a program that cannot continue ends by then
        if begun.poll() is not None:
            raise AssertionError((command, begun.returncode, printed(begun, ENDS_S, command)))

    def leave(self) -> None:
        failed = []
        for command, begun in reversed(self._left_running):
            begun.send_signal(signal.SIGINT)
            try:
                said = printed(begun, ENDS_S, command)
            except AssertionError as error:
                said = ("", str(error))
            if begun.returncode not in ENDED_BY_US or "Traceback" in said[1]:
                failed.append((command, begun.returncode, said))
        assert failed == []


@contextmanager
def reader(folder: Path, prepared: Path | None = None) -> Iterator[Reader]:
    """prepared: a folder in which a pad was set up; this reader finds its files, and its daemon runs."""
    folder.mkdir(exist_ok=True)
    if prepared is not None:
        for name in ("pad.toml", "xdg_state_home"):
            source = prepared / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / name)
    one = Reader(folder)
    try:
        if prepared is not None:
            one.type("fmfts-daemon run")
        yield one
    finally:
        one.leave()
