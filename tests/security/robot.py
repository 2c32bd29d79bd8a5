"""The target of the attacks: a daemon and its page as `fmfts-daemon run` and `view` start them, on a computer of many
users.

No folder around them keeps other users out, so that only the modes that fmfts gives its own files and sockets count.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Origin

from end_to_end.processes import PATIENCE_S, RunningDaemon
from page.rig import View

ATTACKS = Path(__file__).parent / "attacks.py"


class DaemonByDefault(RunningDaemon):
    """A daemon without FMFTS_BUS, so that it makes its folder in XDG_RUNTIME_DIR."""

    def start(self) -> None:
        self.environment.pop("FMFTS_BUS", None)
        self.environment["XDG_RUNTIME_DIR"] = str(self.folder)
        self.base = f"ipc://{self.folder}/fmfts"
        super().start()


class Attack:
    """A program of another user; `gained` waits for its end."""

    def __init__(self, name: str, **arguments: Any) -> None:
        self._process = subprocess.Popen(
            [sys.executable, ATTACKS, name, json.dumps(arguments)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd="/", env=environment_of_nobody(),
        )  # fmt: skip

    def wait_until_ready(self) -> None:
        assert self._process.stdout is not None
        first = self._process.stdout.readline()
        assert first == "ready\n", first + self._process.communicate()[1]

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()

    def gained(self) -> list[str]:
        out, said = self._process.communicate(timeout=10 * PATIENCE_S)
        assert self._process.returncode == 0, f"the attack itself failed: {said}"
        found: list[str] = json.loads(out.splitlines()[-1])
        return found


@contextmanager
def open_folder() -> Iterator[Path]:
    """A folder that every user may enter; pytest's own are closed to others."""
    folder = Path(tempfile.mkdtemp(prefix="fmfts-attacked-"))
    folder.chmod(0o755)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def owner_opens(view: View) -> float:
    """Seconds until the owner's page has a contact, as a browser gets there: its files, then the socket, and again."""
    began_s = time.monotonic()
    while time.monotonic() - began_s < PATIENCE_S:
        try:
            for path in ("/", "/main.js", "/link.js", "/pads.js", "/page.css"):
                _fetch(view.port, path)
            _first_contact(view)
        except (OSError, WebSocketException):
            time.sleep(0.1)
            continue
        return time.monotonic() - began_s
    raise AssertionError(f"the owner did not get in within {PATIENCE_S} s")


def _fetch(port: int, path: str) -> None:
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as peer:
        peer.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        if peer.recv(12) != b"HTTP/1.1 200":
            raise ConnectionError


def _first_contact(view: View) -> None:
    origin = Origin(f"http://127.0.0.1:{view.port}")
    with connect(f"ws://127.0.0.1:{view.port}/socket", origin=origin, proxy=None) as page:
        page.send(json.dumps({"token": view.token}))
        while True:
            batch = page.recv(timeout=PATIENCE_S)
            if isinstance(batch, bytes):
                values = msgpack.Unpacker(raw=False)
                values.feed(batch)
                if any(value == "contact/left" for value in values):
                    return


def environment_of_nobody() -> dict[str, str]:
    """An environment without settings of a user of fmfts."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("FMFTS_", "XDG_"))}
