"""A drift that a running daemon follows: bounded, shown in its status, undone by a verb."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from end_to_end.processes import (
    BRIDGE_CONFIG,
    PATIENCE_S,
    UNTOUCHED_CONFIG,
    FirmwareHost,
    RunningDaemon,
    resting_field,
)
from fmfts.config import PadConfig, SimulatedSource
from fmfts_client import Contact, Status

# 12 µm downward are too little for a touch. A press of PRESSED_M reads about as many mN more for them: with 600 frames,
# to 0.5 mN.
SUNK_M = 12e-6
PRESSED_M = 500e-6
FOLLOWING = """
[pad.scene]
ambient = "constant"
[pad.rebaseline]
enabled = true
quiet_s = 5.0
rate_um_per_hour = 3600.0
limit_um = 10.0
force_below_n = 0.2
"""
PAD = PadConfig(name="left", source=SimulatedSource()).pad()


def sunk(by_m: float) -> np.ndarray:
    """The chips' field with the magnet `by_m` lower: creep of the silicone, or a press."""
    return resting_field(replace(PAD, rest_position_m=PAD.rest_position_m - np.array([0.0, 0.0, by_m])))


@pytest.fixture
def host(tmp_path: Path) -> Iterator[FirmwareHost]:
    with FirmwareHost(tmp_path) as host:
        host.field(sunk(0.0))
        yield host


def wait_for_status(daemon: RunningDaemon, wanted: Callable[[Status], bool]) -> Status:
    deadline = time.monotonic() + 2 * PATIENCE_S
    with daemon.subscribe("status") as messages:
        while True:
            message = messages.receive(PATIENCE_S)
            assert message is not None
            status = Status.from_message(message.body)
            if wanted(status):
                return status
            assert time.monotonic() < deadline, status


def force_of_press(daemon: RunningDaemon, host: FirmwareHost, contacts: int = 600) -> float:
    """Presses the sunk pad, reads the force, and releases it."""
    host.field(sunk(SUNK_M + PRESSED_M))
    daemon.wait_for(lambda contact: contact.contact is True)
    forces: list[float] = []
    with daemon.subscribe() as messages:
        while len(forces) < contacts:
            message = messages.receive(PATIENCE_S)
            assert message is not None
            contact = Contact.from_message(message.body)
            assert contact.contact is True
            assert contact.force_n is not None
            forces.append(contact.force_n)
    host.field(sunk(SUNK_M))
    return float(np.mean(forces))


def test_drift_is_not_followed_unless_enabled(tmp_path: Path) -> None:
    with RunningDaemon(tmp_path, UNTOUCHED_CONFIG) as daemon:
        daemon.wait_for(lambda contact: contact.health == "ok")
        assert wait_for_status(daemon, lambda status: status.health == "ok").rest_drift_m is None
        assert "not followed" in daemon.command("status").stdout


@pytest.mark.slow
def test_drift_is_followed_to_its_bound_shown_and_undone(tmp_path: Path, host: FirmwareHost) -> None:
    with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port) + FOLLOWING) as daemon:
        daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
        recorded = daemon.command("baseline", "--rest", "--duration-s", "5", "--config", daemon.config)
        assert recorded.returncode == 0, recorded.stderr
        daemon.wait_for(lambda contact: contact.health == "ok")
        wait_for_status(daemon, lambda status: status.rest_drift_m is not None)

        before_n = force_of_press(daemon, host)
        # A window that contains the sinking leaves a last step of any size.
        followed = wait_for_status(daemon, lambda status: (status.rest_drift_m or 0.0) > 9.999e-6)
        assert followed.rest_drift_m == pytest.approx(10e-6, rel=1e-6), "12 µm are beyond the bound"
        after_n = force_of_press(daemon, host)
        assert wait_for_status(daemon, lambda status: True).rest_drift_m == pytest.approx(10e-6, rel=1e-6)
        assert "10.0 µm followed" in daemon.command("status").stdout

        undone = daemon.command("baseline", "--undo-drift", "--config", daemon.config)
        assert undone.returncode == 0, undone.stderr
        assert wait_for_status(daemon, lambda status: True).rest_drift_m == 0.0
        undone_n = force_of_press(daemon, host)
        assert before_n - after_n > 3e-3
        assert undone_n - after_n > 3e-3
