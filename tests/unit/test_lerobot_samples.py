"""LeRobot's samples, from messages on a real socket: each once, what is missing counted, and a pause a mask."""

from __future__ import annotations

import importlib
import sys
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq
from bus_messages import contact_message

from fmfts.bus.encoding import encode
from fmfts_client import Client
from fmfts_client.endpoints import for_client

PACKAGE = Path(__file__).parents[2] / "clients/lerobot/lerobot_camera_fmfts"
PAD, MOST, PATIENCE_S = "left", 4, 0.5
NAME = f"observation.tactile.{PAD}"


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Any:
    """samples.py without the package's `__init__`, which imports LeRobot."""
    package = types.ModuleType("lerobot_camera_fmfts")
    package.__path__ = [str(PACKAGE)]
    monkeypatch.setitem(sys.modules, "lerobot_camera_fmfts", package)
    for name in ("touch", "samples"):
        monkeypatch.delitem(sys.modules, f"lerobot_camera_fmfts.{name}", raising=False)
    return importlib.import_module("lerobot_camera_fmfts.samples")


class Bus:
    """Publishes contacts of the pad, and waits until the client has them."""

    def __init__(self, folder: Path, module: Any) -> None:
        base = f"ipc://{folder}"
        self._socket = zmq.Context.instance().socket(zmq.PUB)
        self._socket.bind(for_client(base).bus)
        self.samples = module.Samples([PAD], base, most=MOST, patience_s=60.0)
        self.samples._clients = {PAD: Client(PAD, base)}  # `connect` asks a daemon for the magnet's place
        self.samples._heights_m = {PAD: 0.012}
        self._connected()

    def _connected(self) -> None:
        client = self.samples._clients[PAD]
        while client.latest(0.02) is None:
            self.send(0, sampled_ns=1)

    def send(self, seq: int, sampled_ns: int | None = None, **changes: Any) -> int:
        """Returns when it was sampled (UTC)."""
        message = contact_message(pad=PAD, seq=seq, **changes)
        if sampled_ns is not None:
            message = contact_message(pad=PAD, seq=seq, t_sample_ns=sampled_ns, **changes)
        self._socket.send_multipart([f"contact/{PAD}".encode(), encode(message)])
        return message.utc_ns - (message.t_publish_ns - message.t_sample_ns)

    def frame(self) -> dict[str, np.ndarray]:
        """The next step, once what was sent before has arrived."""
        self.samples._clients[PAD]._subscription.wait(1.0)
        time.sleep(0.2)
        return {key.removeprefix(NAME): value for key, value in self.samples.frame().items()}

    def close(self) -> None:
        self.samples.disconnect()
        self._socket.close(0)


@pytest.fixture
def bus(tmp_path: Path, module: Any) -> Iterator[Bus]:
    made = Bus(tmp_path, module)
    yield made
    made.close()


def test_samples_come_once_and_in_order(bus: Bus) -> None:
    stamps_ns = [bus.send(seq) for seq in (1, 2, 3)]
    step = bus.frame()
    assert step[".mask"].tolist() == [False, True, True, True]
    assert step[".stamps_ns"].tolist() == [0, *stamps_ns]
    assert step[".left_out"] == 0
    later_ns = bus.send(4)
    step = bus.frame()
    assert step[".stamps_ns"].tolist() == [0, 0, 0, later_ns]


def test_gaps_in_seq_are_left_out(bus: Bus) -> None:
    """Within a step, and between two: numbers of messages that never came here."""
    for seq in (1, 2, 5, 6):
        bus.send(seq)
    assert bus.frame()[".left_out"] == 2
    for seq in (10, 11):
        bus.send(seq)
    assert bus.frame()[".left_out"] == 3


def test_samples_without_room_are_left_out(bus: Bus) -> None:
    stamps_ns = [bus.send(seq) for seq in (1, 2, 3, 5, 6, 7, 8)]
    step = bus.frame()
    assert step[".left_out"] == 3 + 1
    assert step[".stamps_ns"].tolist() == stamps_ns[-MOST:]


def test_repeated_sample_is_given_once(bus: Bus) -> None:
    """A daemon repeats the last sample while the pad is silent."""
    now_ns = time.monotonic_ns()
    for seq in (1, 2, 3):
        bus.send(seq, sampled_ns=now_ns)
    step = bus.frame()
    assert (step[".mask"].sum(), step[".left_out"]) == (1, 0)


def test_restarted_daemon_counts_anew(bus: Bus) -> None:
    bus.send(70)
    bus.frame()
    bus.send(1, boot="anew")
    assert bus.frame()[".left_out"] == 0


def test_pause_is_a_mask_and_an_age(bus: Bus) -> None:
    began_s = time.monotonic()
    bus.send(1, force_n=0.7)
    bus.frame()
    time.sleep(0.2)
    step = {key.removeprefix(NAME): value for key, value in bus.samples.frame().items()}
    assert not step[".mask"].any()
    assert not step[".samples"].any()
    assert 0.4 < step[".age_s"][0, 0] < time.monotonic() - began_s + 0.1
    assert step[""][0, 2] == pytest.approx(-0.7)


def test_pad_that_stays_silent_is_lost(bus: Bus, module: Any) -> None:
    bus.send(1)
    bus.frame()
    bus.samples.patience_s = PATIENCE_S
    time.sleep(PATIENCE_S + 0.1)
    with pytest.raises(module.TouchLostError, match="left"):
        bus.samples.frame()


def test_pad_that_knows_nothing_is_lost(bus: Bus, module: Any) -> None:
    """Messages come, and none is usable: each is in the array, and after some time that is no touch."""
    bus.send(1)
    bus.frame()
    unknown = dict.fromkeys(("x_m", "x_sd_m", "y_m", "y_sd_m", "force_n", "force_sd_n"))
    bus.send(2, health="disturbed", reason="steel is near", contact=None, now=None, **unknown)
    assert bus.frame()[".mask"].sum() == 1
    bus.samples.patience_s = PATIENCE_S
    time.sleep(PATIENCE_S)
    bus.send(3, health="disturbed", reason="steel is near", contact=None, now=None, **unknown)
    with pytest.raises(module.TouchLostError, match="steel is near"):
        bus.frame()
