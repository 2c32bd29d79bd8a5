"""The same binary that is flashed, executed on the emulated chip, with an unmodified daemon on its serial line."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from emulator.pace import slowed
from end_to_end.firmware_in_the_loop import EMULATED_CONFIG, PACE, EmulatedBoard, PressedPad, SlowedDaemon
from end_to_end.paper import arrivals
from end_to_end.processes import RunningDaemon
from fmfts.pad import Pad
from fmfts_client import Status

pytestmark = pytest.mark.needs("arm-none-eabi-gcc", "faketime")


@pytest.fixture
def board(tmp_path: Path) -> Iterator[EmulatedBoard]:
    with EmulatedBoard(tmp_path) as board:
        yield board


@pytest.mark.slow
def test_papers_readings_arrive_as_its_poses(tmp_path: Path, board: EmulatedBoard) -> None:
    """The same limits as with the host-built core: the counts that leave the board are the same."""
    with SlowedDaemon(tmp_path, EMULATED_CONFIG.format(port=board.port)) as daemon:
        arrived = list(arrivals(board, daemon))
    assert len(arrived) == 10
    for arrival in arrived:
        assert arrival.distance_m < 0.02e-3, arrival
        assert arrival.angle_deg < 0.15, arrival


def test_press_arrives_in_place_and_lost_sensor_is_reported(tmp_path: Path, board: EmulatedBoard, pad: Pad) -> None:
    with PressedPad(board, pad) as pressed, SlowedDaemon(tmp_path, EMULATED_CONFIG.format(port=board.port)) as daemon:
        daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
        recorded = daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config)
        assert recorded.returncode == 0, recorded.stderr
        daemon.wait_for(lambda contact: contact.health == "ok" and contact.contact is False)
        pressed.touch(2e-3, -1e-3, 1.0)
        touched = daemon.wait_for(lambda contact: contact.contact is True)
        # The step is over; a busy computer may drop frames at that moment, and then reports that instead of numbers.
        contact = daemon.wait_for(lambda contact: contact.seq > touched.seq + 100 and contact.health == "ok")
        # The default model's own errors on this pad, and the noise: its bound is 0.12 mm and 2 % at such a press.
        assert contact.x_m == pytest.approx(2e-3, abs=0.4e-3)
        assert contact.y_m == pytest.approx(-1e-3, abs=0.4e-3)
        assert contact.force_n == pytest.approx(1.0, abs=0.1)
        board.tell("fault 0 2 unplugged")
        daemon.wait_for(lambda contact: contact.health == "degraded" and contact.sensors_ok == 0b1011)
        board.tell("fault 0 2 none")
        daemon.wait_for(lambda contact: contact.health == "ok" and contact.sensors_ok == 0b1111)


def test_daemon_counts_no_error_on_the_emulated_line(tmp_path: Path, board: EmulatedBoard) -> None:
    with SlowedDaemon(tmp_path, EMULATED_CONFIG.format(port=board.port)) as daemon:
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
        with daemon.subscribe("status") as messages:
            statuses = [messages.receive(60.0) for _ in range(4)]
        last = Status.from_message(statuses[-1].body)
        assert last.crc_errors == last.gaps == last.reconnects == 0


def test_status_reports_board_events_and_their_end(tmp_path: Path, board: EmulatedBoard) -> None:
    with SlowedDaemon(tmp_path, EMULATED_CONFIG.format(port=board.port)) as daemon:
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
        for order, told, mend in (
            ("fault 0 2 unplugged", r"sensor 3 .*does not answer at 0x1E", "fault 0 2 none"),
            ("fault 0 1 wrong-id", r"sensor 2 ", "fault 0 1 none"),
            ("mux 0 unplugged", r"the mux does not answer", "mux 0 none"),
        ):
            board.tell(order)
            daemon.wait_for(lambda contact: contact.sensors_ok != 0b1111)
            assert _is_told(daemon, told), order
            board.tell(mend)
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
            assert _is_told_no_more(daemon, told), order


def _is_told(daemon: RunningDaemon, sentence: str) -> bool:
    return any(re.search(sentence, "\n".join(faults)) for faults in _faults(daemon))


def _is_told_no_more(daemon: RunningDaemon, sentence: str) -> bool:
    return any(not re.search(sentence, "\n".join(faults)) for faults in _faults(daemon))


def _faults(daemon: RunningDaemon) -> Iterator[Sequence[str]]:
    """The sentences of the next ten messages of the status topic."""
    with daemon.subscribe("status") as messages:
        for _ in range(10):
            message = messages.receive(60.0)
            assert message is not None
            yield Status.from_message(message.body).sensor_faults


def test_slowed_clock_is_the_same_in_a_process_that_starts_later() -> None:
    def shown_s(began_s: float) -> float:
        command = [sys.executable, "-c", "import time; print(time.monotonic())"]
        environment = os.environ | slowed(PACE, began_s)
        return float(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)

    now_s = time.monotonic()
    at_once_s, later_s = shown_s(now_s), shown_s(now_s - 1000.0)
    # The later clock ran for 1000 s more, of which it lost the share 1 − PACE.
    assert at_once_s - later_s == pytest.approx((1.0 - PACE) * 1000.0, abs=time.monotonic() - now_s)
