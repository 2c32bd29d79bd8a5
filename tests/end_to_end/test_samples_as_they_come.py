"""publish = "sample": a contact for each chip's sample, from the firmware's board to a subscriber, and in a replay."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from end_to_end.firmware_in_the_loop import PressedPad
from end_to_end.processes import BRIDGE_CONFIG, PATIENCE_S, FirmwareHost, RunningDaemon
from fmfts.bus.messages import ContactMessage, EarlyMessage
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad
from fmfts_client import Contact, Status, Subscription
from fmfts_recording.file import HEADER_BYTES, read
from fmfts_simulation.finger import Touch

pytestmark = pytest.mark.real_time

SAMPLES = BRIDGE_CONFIG + 'publish = "sample"\n'
RATE_HZ = 220


def tapping(time_s: float) -> Touch:
    return Touch(1e-3, 1e-3, 0.8 if time_s % 0.5 < 0.25 else 0.2)


@pytest.fixture(scope="module")
def tapped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDaemon]:
    """A daemon with a baseline, whose pad is pressed all the time."""
    folder = tmp_path_factory.mktemp("samples")
    with (
        FirmwareHost(folder) as board,
        PressedPad(board, PadConfig(name="left", source=SimulatedSource()).pad()) as pressed,
        RunningDaemon(folder, SAMPLES.format(port=board.port)) as daemon,
    ):
        record_rest(daemon)
        pressed.press(tapping)
        daemon.wait_for(lambda contact: contact.contact is True and contact.now is not None)
        yield daemon


def record_rest(daemon: RunningDaemon) -> None:
    daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
    recorded = daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config)
    assert recorded.returncode == 0, recorded.stderr
    daemon.wait_for(lambda contact: contact.health == "ok" and contact.contact is False)


def contacts_of(daemon: RunningDaemon, seconds: float) -> list[Contact]:
    with daemon.subscribe() as messages:
        found, until = [], time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            if (message := messages.receive(left)) is not None:
                found.append(Contact.from_message(message.body))
    return found


def test_every_sample_makes_a_contact_and_updates_now(tapped: RunningDaemon) -> None:
    """Four chips and the frames: five times as many contacts as frames, which differ only in `now`."""
    contacts = contacts_of(tapped, 3.0)
    frames = len({contact.t_sample_ns for contact in contacts})
    missing = contacts[-1].seq - contacts[0].seq + 1 - len(contacts)
    assert missing < 0.01 * len(contacts)  # a busy computer may be late with a frame, which is then dropped
    assert len(contacts) > 3.5 * frames
    told = [contact.now.t_ns for contact in contacts if contact.now is not None]
    assert len(told) > 0.9 * len(contacts)
    assert sum(later < earlier for earlier, later in pairwise(told)) < 0.01 * len(told)
    for earlier, later in pairwise(contacts):
        if earlier.t_sample_ns == later.t_sample_ns:
            assert (earlier.force_n, earlier.x_m, earlier.health) == (later.force_n, later.x_m, later.health)


def test_early_samples_are_replayed_identically(tapped: RunningDaemon, tmp_path: Path) -> None:
    """Even if another recorder starts, for which a state is taken in the middle."""
    output = tmp_path / "a.mcap"
    words = [sys.executable, "-m", "fmfts", "record", output, "--json"]
    process = subprocess.Popen(words, env=tapped.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 3 * PATIENCE_S
    while not (output.exists() and output.stat().st_size > HEADER_BYTES and sum(1 for _ in read(output)) > 3000):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.5)
    other = tapped.command("record", tmp_path / "b.mcap", "--seconds", "1")
    assert other.returncode == 0, other.stderr
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=PATIENCE_S)
    kinds = [one.message for one in read(output)]
    assert sum(isinstance(message, EarlyMessage) for message in kinds) > 1000
    assert any(isinstance(message, ContactMessage) and message.now is not None for message in kinds)
    for recording, least in ((output, 1500), (tmp_path / "b.mcap", 300)):
        replayed = tapped.command("replay", recording, "--json")
        assert replayed.returncode == 0, replayed
        facts = json.loads(replayed.stdout)
        assert (facts["different"], facts["unreplayed"]) == (0, 0)
        assert facts["identical"] > least


def test_healthy_minute_reports_no_fault(tapped: RunningDaemon) -> None:
    with tapped.subscribe("status") as messages:
        message = messages.receive(PATIENCE_S)
    assert message is not None
    status = Status.from_message(message.body)
    assert (status.sensor_faults, status.crc_errors, status.garbage_bytes) == ((), 0, 0)
    assert 0.8 * RATE_HZ < status.rate_hz < 1.2 * RATE_HZ


def test_failed_sensor_gives_no_now_between_frames(tmp_path: Path, pad: Pad) -> None:
    with (
        FirmwareHost(tmp_path) as board,
        PressedPad(board, pad) as pressed,
        RunningDaemon(tmp_path, SAMPLES.format(port=board.port)) as daemon,
    ):
        record_rest(daemon)
        pressed.touch(1e-3, 1e-3, 0.8)
        daemon.wait_for(lambda contact: contact.contact is True and contact.now is not None)
        board.tell("fault 0 2 unplugged")
        daemon.wait_for(lambda contact: contact.health == "degraded" and contact.sensors_ok == 0b1011)
        assert all(contact.now is None for contact in contacts_of(daemon, 0.5))
        board.tell("fault 0 2 none")
        daemon.wait_for(lambda contact: contact.health == "ok" and contact.now is not None)


def test_three_pads_of_one_board_publish_every_sample(tmp_path: Path) -> None:
    """A pty, like a board's own USB, has no baud rate: the line carries all of them."""
    pads = [
        SAMPLES.replace('"left"', f'"{name}"') + f"pad_index = {index}\n" for index, name in enumerate(("a", "b", "c"))
    ]
    with (
        FirmwareHost(tmp_path, "--pads", "3") as board,
        RunningDaemon(tmp_path, "".join(pads).format(port=board.port)) as daemon,
    ):
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
        with Subscription(("early",), None, daemon.base) as raw:
            heard: dict[str, int] = {}
            until = time.monotonic() + 2 * PATIENCE_S
            while min(heard.get(name, 0) for name in "abc") < 400:
                assert time.monotonic() < until, heard
                message = raw.receive(1.0)
                if message is not None:
                    heard[message.pad] = heard.get(message.pad, 0) + 1
        with daemon.subscribe("status") as messages:
            message = messages.receive(PATIENCE_S)
        assert message is not None
        assert Status.from_message(message.body).sensor_faults == ()
