"""The real processes that end-to-end tests talk to: the firmware's host build, the daemon, and its commands."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from emulator.priority import put_ahead
from fmfts.pad import Pad
from fmfts_client import Contact, Subscription, UnreachableError, request
from fmfts_simulation.cylinder import cylinder_field

ROOT = Path(__file__).parents[2]
HOST = ROOT / "firmware" / "build" / "fmfts-host"
PATIENCE_S = 60.0  # for what must come at all, on a busy computer
LONG_PATIENCE_S = 300.0  # a replay takes 3 ms of a processor for each frame that Python judges
START_PATIENCE_S = 60.0  # three pads take 3 s of processor time, of which a busy computer gives a seventh


def build_firmware_host() -> None:
    subprocess.run(["make", "--no-print-directory", "-C", ROOT / "firmware", "host"], check=True, capture_output=True)


class FirmwareHost:
    """The firmware core on a pty, over emulated chips; `port` is a link to the pty."""

    def __init__(self, folder: Path, *options: str) -> None:
        build_firmware_host()
        self.port = folder / "board"
        self._process = subprocess.Popen(
            [HOST, "--link", self.port, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self._process.stdout is not None
        first = self._process.stdout.readline()
        assert first.startswith("pty: "), first
        put_ahead(self.pid)

    @property
    def pid(self) -> int:
        return self._process.pid

    def tell(self, command: str) -> None:
        """One command, which must succeed."""
        answer = self.ask(command)
        assert answer == "ok", f"{command}: {answer}"

    def ask(self, command: str) -> str:
        """One command; "ok", or why it is refused now."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(command + "\n")
        return self._process.stdout.readline().strip()

    def frames(self, pad: int = 0) -> int:
        """The number of frames that the board made, including those before a reset."""
        word, _, count = self.ask(f"frames {pad}").partition(" ")
        assert word == "ok", word
        return int(count)

    def field(self, field_t: np.ndarray, pad: int = 0) -> None:
        """The field (4, 3) in tesla at the chips, in their own axes."""
        self.tell(f"field {pad} " + " ".join(f"{value * 1e6:.6f}" for value in field_t.ravel()))

    def glide(self, field_t: np.ndarray, within_s: float, pad: int = 0) -> None:
        """Like `field`; it changes evenly within this time of the board."""
        self.tell(f"glide {pad} {within_s * 1e3:.3f} " + " ".join(f"{value * 1e6:.6f}" for value in field_t.ravel()))

    def kill(self) -> None:
        """Pull the plug. Its name disappears too, as with udev, because another board may get the pty's number at
        once."""
        self.port.unlink(missing_ok=True)
        self._process.kill()
        self._process.communicate()

    def __enter__(self) -> FirmwareHost:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


class RunningDaemon:
    """`fmfts-daemon run` with sockets, state and log in `folder`. endpoint, keys: set by its configuration alone.

    through: words of a command that starts the daemon, such as prlimit.
    """

    def __init__(
        self,
        folder: Path,
        config: str,
        *,
        wait: bool = True,
        endpoint: str | None = None,
        keys: Path | None = None,
        through: Sequence[str] = (),
    ) -> None:
        self.folder = folder
        self._through = through
        self.config = folder / "config.toml"
        self.base = endpoint or f"ipc://{folder}"
        self.environment = os.environ | {"FMFTS_BUS": self.base, "XDG_STATE_HOME": str(folder / "state")}
        if endpoint is not None:
            del self.environment["FMFTS_BUS"]
            config += f'[bus]\nendpoint = "{endpoint}"\n'
            if keys is not None:
                config += f'keys = "{keys}"\n'
        self.config.write_text(config)
        self.log = folder / "daemon.log"
        self.start()
        if wait:
            try:
                self.wait_until_serving()
            except BaseException:  # Ctrl-C among them
                self.__exit__()
                raise

    def start(self) -> None:
        with self.log.open("a") as stderr:
            self.process = subprocess.Popen(
                [*self._through, sys.executable, "-m", "fmfts", "run", "--config", self.config],
                stderr=stderr,
                env=self.environment,
            )
        put_ahead(self.process.pid)  # as its service does

    def wait_until_serving(self, meanwhile: Callable[[], None] = lambda: None, answer_s: float = 1.0) -> None:
        """meanwhile: called before each request. answer_s: how long to wait for its answer."""
        until = time.monotonic() + START_PATIENCE_S
        while True:
            meanwhile()
            try:
                self.request("pads", timeout_s=answer_s)
                return
            except UnreachableError:
                assert self.process.poll() is None, self.log.read_text()
                assert time.monotonic() < until, self.log.read_text()

    def request(self, verb: str, **arguments: Any) -> dict[str, Any]:
        return request(verb, endpoint=self.base, **({"timeout_s": PATIENCE_S} | arguments))

    def command(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        """A verb of fmfts-daemon in this daemon's surroundings."""
        return run_command(*arguments, environment=self.environment)

    def now_ns(self) -> int:
        """The clock of its samples."""
        return time.monotonic_ns()

    def subscribe(self, *kinds: str) -> Subscription:
        return Subscription(kinds or ("contact",), None, self.base)

    def wait_for(
        self,
        wanted: Callable[[Contact], bool],
        patience_s: float = PATIENCE_S,
        act: Callable[[], object] | None = None,
    ) -> Contact:
        """The next contact message for which `wanted` holds. act: called once messages arrive, so that none is missed
        that it causes."""
        with self.subscribe() as messages:
            if act is not None:
                assert messages.receive(patience_s) is not None, self.log.read_text()
                act()
            last = None
            until = time.monotonic() + patience_s
            while (left := until - time.monotonic()) > 0:
                message = messages.receive(left)
                if message is not None:
                    last = Contact.from_message(message.body)
                    if wanted(last):
                        return last
        raise AssertionError(f"nothing of the kind within {patience_s} s; last: {last}\n{self.log.read_text()}")

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(PATIENCE_S)

    def __enter__(self) -> RunningDaemon:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


def run_command(*arguments: str | Path, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    words: Sequence[str | Path] = [sys.executable, "-m", "fmfts", *arguments]
    return subprocess.run(words, capture_output=True, text=True, env=environment, timeout=LONG_PATIENCE_S, check=False)


BRIDGE_CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "bridge"
port = "{port}"
"""


UNTOUCHED_CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
finger = "none"
"""


def resting_field(pad: Pad) -> np.ndarray:
    """The field (4, 3) in tesla at the chips of an unloaded pad, built exactly as drawn, far from any other field."""
    places = pad.sensors.position_m
    positions, axes = np.tile(pad.rest_position_m, (len(places), 1)), np.tile(pad.rest_axis, (len(places), 1))
    return cylinder_field(places, positions, axes, pad.magnet)
