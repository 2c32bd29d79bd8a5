"""A pad on a moving hand: taught by the verb with joint positions over ZeroMQ, then touched while the hand moves.

The board is the real firmware over emulated chips; the hand is tests/emulator/hand_magnets.py.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulator.hand_magnets import HandMagnets
from end_to_end.processes import BRIDGE_CONFIG, PATIENCE_S, FirmwareHost, RunningDaemon, resting_field, run_command
from fmfts.pad import Pad
from fmfts_client import Contact, JointPublisher

SCENE = '\n[pad.scene]\nambient = "posture"\n'
# Uneven by some 10 µT over the pad, so that a pad without a model of the hand is disturbed.
HAND = HandMagnets(moment_am2=0.01, period_s=3.0)
PRESSED_M = 0.5e-3
STEP_S = 0.01


class MovingHand:
    """Moves the magnets past the emulated chips, and publishes the joints. pressed_m: how far the pad's own magnet is
    down."""

    def __init__(self, host: FirmwareHost, pad: Pad, endpoint: str) -> None:
        self.pressed_m, self.publishes, self.is_untouched = 0.0, True, True
        self._host, self._pad, self._endpoint = host, pad, endpoint
        self._begun_s = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def set_field(self, time_s: float) -> None:
        pad = replace(self._pad, rest_position_m=self._pad.rest_position_m - np.array([0.0, 0.0, self.pressed_m]))
        sensors = pad.sensors.position_m
        by_hand = HAND.field(sensors, np.full(len(sensors), time_s))
        self._host.field(resting_field(pad) + pad.sensors.to_sensor(by_hand))

    def _run(self) -> None:
        with JointPublisher(self._endpoint) as publisher:
            while not self._stop.wait(STEP_S):
                time_s = time.monotonic() - self._begun_s
                self.set_field(time_s)
                if self.publishes:
                    publisher.publish(HAND.joints_rad(time_s))

    @contextmanager
    def moving(self) -> Iterator[MovingHand]:
        self._begun_s = time.monotonic()
        self._thread.start()
        try:
            yield self
        finally:
            self._stop.set()
            self._thread.join()


def heard(daemon: RunningDaemon, seconds: float) -> list[Contact]:
    out, until = [], time.monotonic() + seconds
    with daemon.subscribe() as messages:
        while time.monotonic() < until:
            message = messages.receive(PATIENCE_S)
            assert message is not None
            out.append(Contact.from_message(message.body))
    return out


def share(contacts: list[Contact], health: str) -> float:
    return sum(contact.health == health for contact in contacts) / len(contacts)


@pytest.mark.real_time
def test_posture_of_a_moving_hand_is_recorded_and_a_touch_found(tmp_path: Path, host: FirmwareHost, pad: Pad) -> None:
    config = BRIDGE_CONFIG.format(port=host.port) + SCENE
    with RunningDaemon(tmp_path, config) as daemon:
        hand = MovingHand(host, pad, daemon.environment["FMFTS_BUS"])
        hand.set_field(0.0)
        rested = daemon.command("baseline", "--rest", "--config", daemon.config)
        assert rested.returncode == 0, rested.stderr
        told = daemon.wait_for(lambda contact: contact.health == "degraded")
        assert "was not taught: `fmfts-daemon baseline --posture`" in told.reason
        with hand.moving():
            untaught = heard(daemon, 4.0)
            assert share(untaught, "disturbed") > 0.2
            taught = daemon.command("baseline", "--posture", "--duration-s", "12", "--config", daemon.config, "--json")
            assert taught.returncode == 0, taught.stderr
            facts = json.loads(taught.stdout)
            assert facts["posture_joints"] == ["knuckle", "middle", "still"]
            assert facts["posture_left_t"] < 0.3 * facts["posture_uneven_t"]
            time.sleep(0.5)
            untouched = heard(daemon, 6.0)
            assert share(untouched, "ok") > 0.9, {contact.reason for contact in untouched}
            assert not any(contact.contact for contact in untouched)
            hand.pressed_m = PRESSED_M
            time.sleep(0.3)
            touched = heard(daemon, 6.0)
            known = [contact for contact in touched if contact.health == "ok"]  # a late computer misses joints
            assert len(known) > 0.5 * len(touched)
            assert sum(contact.contact is True for contact in known) > 0.95 * len(known)
            file = tmp_path / "hand.mcap"
            words = [sys.executable, "-m", "fmfts", "record", file, "--seconds", "3"]
            subprocess.run(words, env=daemon.environment, check=True, capture_output=True, timeout=300)
            hand.publishes = False
            silent = daemon.wait_for(lambda contact: "stopped arriving" in contact.reason)
            assert silent.health in ("degraded", "lost", "disturbed")
            hand.publishes = True
            daemon.wait_for(lambda contact: contact.health == "ok")
    replayed = run_command("replay", file, "--json")
    assert replayed.returncode == 0, replayed.stdout
    facts = json.loads(replayed.stdout)
    assert facts["identical"] > 300
    assert facts["different"] == 0
