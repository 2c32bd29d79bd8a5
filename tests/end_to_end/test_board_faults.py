"""Faults of a board while its pad is in use: each fault on the real processes, and the daemon's report."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from end_to_end.processes import BRIDGE_CONFIG, PATIENCE_S, FirmwareHost, RunningDaemon, resting_field
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad
from fmfts_client import Status

ATTEMPTS = 5


@pytest.fixture
def daemon(tmp_path: Path, host: FirmwareHost) -> Iterator[RunningDaemon]:
    with reading(tmp_path, host) as daemon:
        yield daemon


@contextmanager
def reading(folder: Path, host: FirmwareHost) -> Iterator[RunningDaemon]:
    """A daemon that reads the host's board, its baseline recorded."""
    with RunningDaemon(folder, BRIDGE_CONFIG.format(port=host.port)) as daemon:
        daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
        recorded = daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config)
        assert recorded.returncode == 0, recorded.stderr
        daemon.wait_for(lambda contact: contact.health == "ok")
        yield daemon


def statuses_of(daemon: RunningDaemon) -> Iterator[Status]:
    """The next statuses, for a while."""
    with daemon.subscribe("status") as messages:
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            message = messages.receive(PATIENCE_S)
            assert message is not None
            yield Status.from_message(message.body)
    raise AssertionError(f"no such status:\n{daemon.log.read_text()}")


def status_of(daemon: RunningDaemon) -> Status:
    """The next status after the board sent its own: once connected it does so every second."""
    return next(status for status in statuses_of(daemon) if "transmit_dropped" in status.board)


def frames_lost_to(daemon: RunningDaemon, act: Callable[[], None]) -> tuple[int, Status]:
    """The status after `act`. Repeated if the daemon stood still: then the board drops packets, and the daemon drops
    frames."""
    for _ in range(ATTEMPTS):
        before = status_of(daemon)
        act()
        time.sleep(1.2)  # a status comes every second
        after = status_of(daemon)
        while (later := status_of(daemon)).gaps != after.gaps:  # it may lag behind the board
            after = later
        if after.board["transmit_dropped"] == before.board["transmit_dropped"] and after.dropped == before.dropped:
            break
    return after.gaps - before.gaps, after


@pytest.fixture(scope="module")
def used(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[FirmwareHost, RunningDaemon]]:
    """A board and the daemon that reads it, for several tests."""
    folder, pad = tmp_path_factory.mktemp("board"), PadConfig(name="standard", source=SimulatedSource()).pad()
    with FirmwareHost(folder) as host:
        host.field(resting_field(pad))
        with reading(folder, host) as daemon:
            yield host, daemon


class OnOneBoard:
    """Tests of one board and its daemon; the board is whole again after each."""

    @pytest.fixture
    def host(self, used: tuple[FirmwareHost, RunningDaemon]) -> FirmwareHost:
        return used[0]

    @pytest.fixture
    def daemon(self, used: tuple[FirmwareHost, RunningDaemon]) -> Iterator[RunningDaemon]:
        host, daemon = used
        yield daemon
        for sensor in range(4):
            host.tell(f"fault 0 {sensor} none")
        host.tell("mux 0 none")
        daemon.wait_for(lambda contact: contact.health == "ok" and contact.sensors_ok == 0b1111)


class TestBoard:
    def test_unplugged_board_is_disconnected_and_comes_back(
        self, tmp_path: Path, host: FirmwareHost, daemon: RunningDaemon, pad: Pad
    ) -> None:
        host.kill()
        gone = daemon.wait_for(lambda contact: contact.health == "disconnected")
        assert gone.force_n is None
        assert gone.contact is None
        with FirmwareHost(tmp_path) as again:
            again.field(resting_field(pad))
            # Plugged in again, its baseline still holds.
            daemon.wait_for(lambda contact: contact.health == "ok")
            assert status_of(daemon).reconnects >= 1

    @pytest.mark.real_time  # a board delayed by a busy computer is stale
    def test_wrap_of_a_32_bit_microsecond_counter_is_not_noticed(
        self, host: FirmwareHost, daemon: RunningDaemon
    ) -> None:
        host.tell(f"time {2**32 - 500_000}")
        daemon.wait_for(lambda contact: contact.health == "ok")
        before = status_of(daemon)
        with daemon.subscribe() as messages:
            for _ in range(300):  # 1.4 s, across the wrap
                message = messages.receive(PATIENCE_S)
                assert message is not None
                assert (message.body["health"], message.body["reason"]) == ("ok", "")
        assert status_of(daemon).gaps == before.gaps


class TestStream(OnOneBoard):
    def test_garbage_between_packets_costs_no_frame(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        garbage_before = status_of(daemon).garbage_bytes

        def throw_garbage() -> None:
            for seed in range(20):
                host.tell(f"garbage {1 + 13 * seed} {seed}")

        lost, after = frames_lost_to(daemon, throw_garbage)
        # Garbage that meets a packet's first bytes destroys that packet, and no other.
        assert lost <= 20
        assert after.garbage_bytes > garbage_before
        daemon.wait_for(lambda contact: contact.health == "ok")

    @pytest.mark.real_time  # a status that lags by seconds does not count them yet
    def test_truncated_packet_costs_at_most_the_next_one(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        def truncate() -> None:
            for _ in range(5):
                host.tell("truncate")
                time.sleep(0.05)

        lost, _ = frames_lost_to(daemon, truncate)
        # A packet that lost its end mark runs into the next one.
        assert 5 <= lost <= 10
        daemon.wait_for(lambda contact: contact.health == "ok")

    def test_firmware_reset_is_survived(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        host.tell("reset")
        daemon.wait_for(lambda contact: contact.health == "ok")


class TestSensors(OnOneBoard):
    @pytest.mark.parametrize(("fault", "sensor"), [("unplugged", 0), ("unplugged", 2), ("wrong-id", 1)])
    def test_sensor_that_does_not_answer_is_left_out_and_named(
        self, host: FirmwareHost, daemon: RunningDaemon, fault: str, sensor: int
    ) -> None:
        host.tell(f"fault 0 {sensor} {fault}")
        degraded = daemon.wait_for(
            lambda contact: contact.health == "degraded" and not contact.sensors_ok & (1 << sensor)
        )
        assert f"sensor {sensor + 1}" in degraded.reason
        assert degraded.pose is not None
        assert degraded.contact is False
        faults = next(status.sensor_faults for status in statuses_of(daemon) if status.sensor_faults)
        assert f"sensor {sensor + 1}" in faults[0]
        host.tell(f"fault 0 {sensor} none")
        daemon.wait_for(lambda contact: contact.health == "ok" and contact.sensors_ok == 0b1111)

    @pytest.mark.parametrize("axis", ["x", "y", "z"])
    def test_saturated_axis_is_left_out_and_flagged(
        self, host: FirmwareHost, daemon: RunningDaemon, pad: Pad, axis: str
    ) -> None:
        host.tell(f"fault 0 1 saturate-{axis}")
        degraded = daemon.wait_for(lambda contact: contact.health == "degraded")
        assert degraded.reason == f"sensor 2 is saturated on {axis} at ±2.5 G (set range_gauss = 4): left out"
        assert degraded.sensors_ok == 0b1101
        probed = daemon.request("probe")["pads"][0]
        # A busy computer may lose packets as well, and reports how many.
        faults = [told for told in probed["faults"] if "packets left out" not in told]
        assert faults == [degraded.reason.removesuffix(": left out")]
        assert not probed["sound"]
        assert any(
            [told for told in status.sensor_faults if "packets left out" not in told] == faults
            for status in statuses_of(daemon)
        )
        assert degraded.pose is not None
        # Eleven values instead of twelve: the pose stays within five of its own deviations.
        deviation = np.array(degraded.pose.position_sd_m)
        assert (np.abs(np.array(degraded.pose.position_m) - pad.rest_position_m) < 5 * deviation).all()
        assert degraded.contact is False

    def test_two_dead_sensors_are_lost_without_numbers(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        host.tell("fault 0 0 unplugged")
        host.tell("fault 0 3 unplugged")
        lost = daemon.wait_for(lambda contact: contact.health == "lost")
        assert (lost.pose, lost.force_n, lost.contact) == (None, None, None)

    def test_dead_mux_causes_no_contact(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        host.tell("mux 0 unplugged")
        lost = daemon.wait_for(lambda contact: contact.health in ("lost", "stale"))
        assert lost.contact is None
        host.tell("mux 0 none")
        daemon.wait_for(lambda contact: contact.health == "ok")

    def test_time_of_the_last_sample_stays_while_no_sensor_answers(
        self, host: FirmwareHost, daemon: RunningDaemon
    ) -> None:
        host.tell("mux 0 unplugged")
        before = daemon.wait_for(lambda contact: contact.sensors_ok == 0)
        after = daemon.wait_for(  # the board goes on sending
            lambda contact: contact.seq > before.seq + 100 and contact.t_publish_ns > before.t_publish_ns + 2e9
        )
        assert after.sensors_ok == 0
        assert after.t_sample_ns == before.t_sample_ns
        # A status is of the second before it, which a busy computer makes longer: the next one has no sample.
        status = next(each for each in statuses_of(daemon) if each.latency_max_s is None)
        assert status.rate_hz > 1.0  # the rate counts frames, whatever they hold; a busy computer drops many
        host.tell("mux 0 none")
        daemon.wait_for(lambda contact: contact.health == "ok")


class TestBaseline:
    def test_missing_baseline_gives_neither_pose_nor_force(self, tmp_path: Path, host: FirmwareHost) -> None:
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port)) as daemon:
            contact = daemon.wait_for(lambda contact: contact.health == "no_baseline")
        assert (contact.pose, contact.force_n, contact.contact, contact.x_m) == (None, None, None, None)
        assert "fmfts-daemon baseline" in contact.reason

    def test_refused_baseline_changes_nothing(self, host: FirmwareHost, daemon: RunningDaemon, pad: Pad) -> None:
        before = daemon.wait_for(lambda contact: contact.health == "ok").baseline
        host.field(-resting_field(pad))
        refused = daemon.command("baseline", "--rest", "--config", daemon.config)
        assert refused.returncode == 65
        assert "upside down" in refused.stderr
        host.field(resting_field(pad))
        assert daemon.wait_for(lambda contact: contact.health == "ok").baseline == before

    def test_damaged_file_is_reported_and_not_used(
        self, tmp_path: Path, host: FirmwareHost, daemon: RunningDaemon
    ) -> None:
        assert daemon.stop() == 0
        stored = tmp_path / "state" / "fmfts" / "baseline" / "left.json"
        stored.write_text(stored.read_text()[:300])
        daemon.start()
        daemon.wait_until_serving()
        assert daemon.wait_for(lambda contact: contact.health == "no_baseline").force_n is None
        assert "left.json is damaged" in daemon.log.read_text()

    def test_stored_baseline_is_used_after_a_restart(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        before = daemon.wait_for(lambda contact: contact.health == "ok")
        assert daemon.stop() == 0
        daemon.start()
        daemon.wait_until_serving()
        after = daemon.wait_for(lambda contact: contact.health == "ok")
        assert after.baseline == before.baseline
        assert after.boot != before.boot


class TestSecondDaemon(OnOneBoard):
    def test_same_device_is_refused_with_the_firsts_pid(
        self, tmp_path: Path, host: FirmwareHost, daemon: RunningDaemon
    ) -> None:
        elsewhere = tmp_path / "elsewhere"
        elsewhere.mkdir()
        with RunningDaemon(elsewhere, BRIDGE_CONFIG.format(port=host.port)) as second:
            refused = second.wait_for(lambda contact: contact.health == "disconnected")
            assert str(daemon.process.pid) in refused.reason
        daemon.wait_for(lambda contact: contact.health == "ok")

    def test_probe_beside_a_running_daemon_goes_through_it(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        found = daemon.command("probe", "--config", daemon.config)
        assert found.returncode == 0, found.stdout + found.stderr
        assert "connected: yes" in found.stdout
        daemon.wait_for(lambda contact: contact.health == "ok")

    def test_probe_waits_for_a_board_that_is_silent_for_a_moment(
        self, host: FirmwareHost, daemon: RunningDaemon
    ) -> None:
        os.kill(host.pid, signal.SIGSTOP)
        daemon.wait_for(lambda contact: contact.health == "stale")
        goes_on = threading.Timer(1.0, os.kill, (host.pid, signal.SIGCONT))
        goes_on.start()
        found = daemon.command("probe", "--config", daemon.config)
        goes_on.join()
        assert found.returncode == 0, found.stdout + found.stderr

    def test_selftest_goes_through_the_running_daemon(self, host: FirmwareHost, daemon: RunningDaemon) -> None:
        tested = daemon.command("selftest", "--config", daemon.config)
        assert tested.returncode == 0, tested.stderr + tested.stdout
        daemon.wait_for(lambda contact: contact.health == "ok")
