"""The pads of a model on the bus: MuJoCo runs in real time and feeds a daemon, whose clients notice no difference."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
from fmfts.baseline.files import store
from fmfts.bus.encoding import encode
from fmfts.bus.frame_message import frame_message
from fmfts.config.file import load
from fmfts.sensor.frame import Frame
from fmfts_client import Client, Contact, Endpoints

from fmfts_mujoco.boards import NS, START_S, Faults
from fmfts_mujoco.places import ModelError
from fmfts_mujoco.scene import Scene
from fmfts_mujoco.setting_up import baselines

LATEST_S = 0.02  # when this computer was busy for longer, the robot's time continues later, as if it had stopped


class Robot:
    """Feeds a daemon from `model`: `step` after each `mj_step` waits for its real time, and sends what is due.

    unsent: frames that no daemon took. late: how often this computer was too slow.
    `contacts` is as that of `Pads`, for a program that wants both; any client of the bus reads the same.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        config: Path | str,
        endpoint: str | Endpoints | None = None,
        *,
        as_built: bool = False,
        seed: int | np.random.Generator = 0,
    ) -> None:
        """config: the daemon's file; each pad has `frames_from`. endpoint: of the daemon. as_built: pads differ from
        their drawing as their tolerances say, always by the same. seed: of the noise, the clocks, and the silicone and
        fingers of pads as built; the same seed sends the same. ModelError, ConfigError."""
        mujoco.mj_forward(model, data)
        pads = load(Path(config))[0].pad
        self.scene = Scene(model, pads, as_built=as_built)
        self.paths = []
        for pad in pads:
            path = pad.source.frames_from  # type: ignore[union-attr]
            if path is None:
                raise ModelError(f"pad '{pad.name}': [pad.source] needs frames_from, where the daemon takes its frames")
            self.paths.append(path)
        self._names = [pad.name for pad in pads]
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._clients = {name: Client(name, endpoint) for name in self._names}
        self._boot = os.urandom(4).hex()
        self._started_ns = 0
        self.unsent, self.late = 0, 0
        self.baselines = baselines(self.scene, data)
        self.scene.start(np.random.default_rng(seed))

    def store_baselines(self, environ: Mapping[str, str] = os.environ) -> None:
        """Record the pads at the robot's first pose, into the folder where a daemon with this environment reads them at
        its start."""
        for pad in self.scene.pads:
            store(self.baselines[pad.name], pad.pad(), environ)

    def reset(self, random: np.random.Generator) -> None:
        """Does nothing: whatever happens to the model, the boards stay switched on. As `Pads.reset` otherwise."""

    @property
    def faults(self) -> dict[str, Faults]:
        """The faults of each pad; may be changed at any time."""
        return self.scene.faults

    @property
    def now_ns(self) -> int:
        """The time on the clock of the messages."""
        return time.monotonic_ns()

    def step(self, data: mujoco.MjData) -> None:
        """Take over the step that `mj_step` just did, when its time has come."""
        recorded_s = self.scene.record(data)
        now_ns = time.monotonic_ns()
        due_ns = self._started_ns + round(recorded_s * NS)
        if not self._started_ns or now_ns - due_ns > LATEST_S * NS:
            self.late += bool(self._started_ns)
            self._started_ns = now_ns - round(recorded_s * NS)
        elif due_ns > now_ns:
            time.sleep((due_ns - now_ns) * 1e-9)
        if recorded_s >= self.scene.boards.due_s:
            for name, path, frames in zip(self._names, self.paths, self.scene.frames(), strict=True):
                for frame in frames:
                    self._send(name, path, frame)

    def contacts(self) -> dict[str, list[Contact]]:
        """The messages of each pad that arrived since the last call."""
        return {name: list(client.contacts(0.0)) for name, client in self._clients.items()}

    def close(self) -> None:
        self._socket.close()
        for client in self._clients.values():
            client.close()

    def _send(self, name: str, path: str, frame: Frame) -> None:
        """Like a board: whether anybody listens or not."""
        sampled_ns = frame.host_time_ns - round(START_S * NS) + self._started_ns
        message = frame_message(frame.at(sampled_ns), name, self._boot, time.time_ns())
        try:
            self._socket.sendto(encode(message), path)
        except (BlockingIOError, ConnectionRefusedError, FileNotFoundError):
            self.unsent += 1
