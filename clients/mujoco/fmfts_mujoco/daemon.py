"""A daemon of one's own for the pads of a model, with its sockets and baselines in a folder that is thrown away."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType

from fmfts_client import UnreachableError, request

from fmfts_mujoco.over_bus import Robot

PATIENCE_S = 60.0


class Daemon:
    """config: a copy of the daemon's file, whose `frames_from` are in the same folder. endpoint: for its clients."""

    def __init__(self, config: Path) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="fmfts-"))
        self.config = self._folder / config.name
        shutil.copy(config, self.config)
        self.endpoint = f"ipc://{self._folder}"
        self._environment = os.environ | {"FMFTS_BUS": self.endpoint, "XDG_STATE_HOME": str(self._folder)}
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, robot: Robot) -> None:
        """Record the baselines of the robot's pads as it stands, and start. RuntimeError if it does not start."""
        robot.store_baselines(self._environment)
        log = self._folder / "daemon.log"
        words = [sys.executable, "-m", "fmfts", "run", "--config", str(self.config)]
        with log.open("w") as errors:
            self._process = subprocess.Popen(words, stderr=errors, env=self._environment)
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                request("pads", endpoint=self.endpoint, timeout_s=1.0)
                return
            except UnreachableError as error:
                if self._process.poll() is not None or time.monotonic() > until:
                    raise RuntimeError(f"the daemon does not start: {log.read_text()}") from error

    def __enter__(self) -> Daemon:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)
