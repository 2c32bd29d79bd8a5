"""Three robots: daemons with CURVE on three addresses of the loopback, and the page that shows them all."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from end_to_end.processes import BRIDGE_CONFIG, PATIENCE_S, UNTOUCHED_CONFIG, RunningDaemon
from fmfts.bus.keys import KeyFolder
from fmfts_client import Endpoints
from page.rig import View
from ports import tcp_base

NAMES = ("arm", "leg", "head")
UNPLUGGED = BRIDGE_CONFIG.replace("left", "right").format(port="/dev/no-such-board")  # a second pad of the head
Facts = dict[str, dict[str, Any]]


class Robots:
    """Each has a list of keys of its own; `keys` has the client's key for each, as --robot-keys wants them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.keys = folder / "keys"
        self.keys.mkdir()
        self.daemons: dict[str, RunningDaemon] = {}
        for number, name in enumerate(NAMES, 1):
            home = folder / name
            home.mkdir()
            KeyFolder(home / "keys").add("desk", self.keys / f"{name}.key", may_change=True)
            base = tcp_base().replace("127.0.0.1", f"127.0.0.{number}")
            config = UNTOUCHED_CONFIG + (UNPLUGGED if name == "head" else "")
            self.daemons[name] = RunningDaemon(home, config, endpoint=base, keys=home / "keys", wait=False)

    def endpoints(self, name: str) -> Endpoints:
        return Endpoints.from_base(self.daemons[name].base, self.keys / f"{name}.key")

    def options(self, keys: Path | None, names: Sequence[str] = NAMES) -> list[str]:
        """Of `fmfts-daemon view`."""
        words = [word for name in names for word in ("--robot", f"{name}={self.daemons[name].base}")]
        return words if keys is None else [*words, "--robot-keys", str(keys)]

    @contextmanager
    def view(self, keys: Path | None, names: Sequence[str] = NAMES, **environment: str) -> Iterator[View]:
        """The page's server, with the keys of a folder."""
        own = {name: text for name, text in self.daemons["arm"].environment.items() if name != "FMFTS_KEY"}
        with View(self.folder, own | environment, *self.options(keys, names)) as view:
            yield view

    def close(self) -> None:
        for daemon in self.daemons.values():
            daemon.__exit__()


class OpenPage:
    """A page that receives what a browser would. place: "/" of the fleet, "/robot/NAME/" of one robot."""

    def __init__(self, view: View, place: str = "/", token: str | None = None) -> None:
        address, origin = f"ws://127.0.0.1:{view.port}{place}socket", f"http://127.0.0.1:{view.port}"
        # A test that does not read for a while must still be able to disconnect.
        self._open = connect(address, proxy=None, origin=origin, max_queue=None)  # type: ignore[arg-type]
        self._token = view.token if token is None else token
        self.socket: ClientConnection

    def told(self) -> Facts:
        """The next report of all robots, by name."""
        while True:
            text = self.socket.recv(timeout=PATIENCE_S)
            if isinstance(text, str) and "fleet" in (told := json.loads(text)):
                return {robot["name"]: robot for robot in told["fleet"]}

    def until(self, wanted: Callable[[Facts], bool], patience_s: float = PATIENCE_S) -> Facts:
        """The first report for which `wanted` holds."""
        end = time.monotonic() + patience_s
        while not wanted(told := self.told()):
            assert time.monotonic() < end, told
        return told

    def asked(self, **request: Any) -> dict[str, Any]:
        """The answer to a request."""
        self.socket.send(json.dumps({"id": 1, **request}))
        while True:
            text = self.socket.recv(timeout=PATIENCE_S)
            if isinstance(text, str) and (answer := json.loads(text)).get("id") == 1 and "progress" not in answer:
                return dict(answer)

    def __enter__(self) -> OpenPage:
        self.socket = self._open.__enter__()
        self.socket.send(json.dumps({"token": self._token}))
        return self

    def __exit__(self, *_: object) -> None:
        self._open.__exit__(None, None, None)


def are(state: str, *names: str) -> Callable[[Facts], bool]:
    """True if all these robots have this state."""
    return lambda told: all(told[name]["state"] == state for name in names)
