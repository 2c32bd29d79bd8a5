"""The drills of `make drills`, small enough for every test run. Each asserts what must hold at any size."""

from __future__ import annotations

from pathlib import Path

import pytest

from drills import anyskin_drills, beside, control_fuzz, daemon_drills, recovery
from drills.chaos.drill import MUST_BE_NONE, Drill
from end_to_end import kernel_bus
from needed import missing

# A finger that moves by the clock is judged at the times of the samples, and an emulated board without a processor is
# late.
pytestmark = [pytest.mark.real_time, pytest.mark.slow]


def test_replugged_boards_come_back_and_leave_no_descriptor(tmp_path: Path) -> None:
    recovery.replug(tmp_path, 10)


def test_reset_amid_a_packet_is_survived(tmp_path: Path) -> None:
    recovery.reset_in_a_frame(tmp_path, 3)


def test_random_bytes_between_frames_bring_no_wrong_number(tmp_path: Path) -> None:
    recovery.garbage(tmp_path, 50_000)


def test_storm_of_nacks_gives_no_wrong_number_and_pad_recovers(tmp_path: Path) -> None:
    recovery.nack_storm(tmp_path, 2.0)


def test_wedged_bus_is_reported_and_other_pad_goes_on(tmp_path: Path) -> None:
    if kernel_bus.missing():
        missing(kernel_bus.PACKAGES)
    daemon_drills.wedged_bus(tmp_path, 2.0)


def test_killed_write_leaves_the_old_baseline_or_the_new(tmp_path: Path) -> None:
    daemon_drills.killed_in_a_write(tmp_path, 3)


def test_subscriber_that_never_reads_delays_no_other(tmp_path: Path) -> None:
    daemon_drills.deaf_subscriber(tmp_path, 2.0)


def test_wall_clock_that_jumps_disturbs_nothing(tmp_path: Path) -> None:
    daemon_drills.clock_set_back(tmp_path, 1.0)


def test_random_requests_are_answered_and_change_nothing(tmp_path: Path) -> None:
    control_fuzz.fuzzed_control(tmp_path, 10_000)


def test_probe_beside_the_daemon_disturbs_no_contact(tmp_path: Path) -> None:
    beside.probed(tmp_path, 3)


def test_replugged_anyskin_board_comes_back(tmp_path: Path) -> None:
    anyskin_drills.unplugged(tmp_path, 2)


def test_damaged_packets_of_anyskin_board_bring_no_wrong_number(tmp_path: Path) -> None:
    anyskin_drills.damaged(tmp_path, 12)


def test_wrong_anyskin_baud_rate_is_reported_and_recovers(tmp_path: Path) -> None:
    anyskin_drills.other_baud(tmp_path, 2)


def test_pairs_of_faults_give_no_wrong_number_and_recover(tmp_path: Path) -> None:
    facts = Drill(tmp_path, pads=3, seed=1, any_age=True).run(frames=1_000_000, seconds=12.0)
    assert {name: facts[name] for name in MUST_BE_NONE} == dict.fromkeys(MUST_BE_NONE, 0), facts
    assert facts["judged_pressed"] > 0, facts
