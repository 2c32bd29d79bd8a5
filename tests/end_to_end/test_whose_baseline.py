"""A baseline belongs to the sensors that it was recorded with: the daemon refuses another board's."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from end_to_end.processes import BRIDGE_CONFIG, UNTOUCHED_CONFIG, FirmwareHost, RunningDaemon, resting_field
from fmfts.baseline import Baseline, encode
from fmfts.pad import Pad

ONE, OTHER = "31" * 12, "42" * 12


def file_of(daemon: RunningDaemon) -> Path:
    return daemon.folder / "state" / "fmfts" / "baseline" / "left.json"


def record(daemon: RunningDaemon) -> str:
    ended = daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_baseline_of_another_board_is_refused_until_its_own_board_is_back(tmp_path: Path, pad: Pad) -> None:
    """Without a uid in the configuration, the boards are distinguished by their own reports."""
    with FirmwareHost(tmp_path, "--uid", ONE) as host:
        host.field(resting_field(pad))
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port)) as daemon:
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
            assert f"recorded on: board {ONE}, pad_index 0, hmc5983" in record(daemon)
            assert json.loads(file_of(daemon).read_bytes())["origin"]["uid"] == ONE
            daemon.wait_for(lambda contact: contact.health == "ok")
            host.kill()
            daemon.wait_for(lambda contact: contact.health == "disconnected")
            with FirmwareHost(tmp_path, "--uid", OTHER) as other:
                other.field(resting_field(pad) * 1.02)  # other gains: a touch, with the first one's baseline
                refused = daemon.wait_for(lambda contact: contact.health == "no_baseline")
                assert (refused.contact, refused.force_n, refused.pose) == (None, None, None)
                assert f"its baseline was recorded on board {ONE}" in refused.reason
                assert f"but the pad is on board {OTHER}" in refused.reason
                assert "fmfts-daemon baseline --bare --pad left" in refused.reason
                daemon.stop()
                daemon.start()  # and from the start
                daemon.wait_until_serving()
                again = daemon.wait_for(
                    lambda contact: contact.health != "disconnected" and contact.sensors_ok == 0b1111
                )
                assert (again.health, again.contact) == ("no_baseline", None)
            daemon.wait_for(lambda contact: contact.health == "disconnected")
            with FirmwareHost(tmp_path, "--uid", ONE) as back:
                back.field(resting_field(pad))
                assert daemon.wait_for(lambda contact: contact.health == "ok").contact is False
            daemon.wait_for(lambda contact: contact.health == "disconnected")
            with FirmwareHost(tmp_path, "--uid", OTHER) as other:
                other.field(resting_field(pad) * 1.02)
                daemon.wait_for(lambda contact: contact.health == "no_baseline")
                record(daemon)
                daemon.wait_for(lambda contact: contact.health == "ok")


def test_simulated_pad_does_not_take_a_boards_baseline(tmp_path: Path, pad: Pad) -> None:
    with FirmwareHost(tmp_path, "--uid", ONE) as host:
        host.field(resting_field(pad))
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port)) as daemon:
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
            record(daemon)
    before = file_of(daemon).read_bytes()
    with RunningDaemon(tmp_path, UNTOUCHED_CONFIG) as daemon:
        daemon.wait_for(lambda contact: contact.health == "ok" and contact.contact is False)
        assert f"recorded on board {ONE}" in daemon.log.read_text()
    assert file_of(daemon).read_bytes() == before


@pytest.mark.parametrize("option", ["--turn", "--refine"])
def test_baseline_of_another_board_is_not_improved(tmp_path: Path, pad: Pad, option: str) -> None:
    with FirmwareHost(tmp_path, "--uid", ONE) as host:
        host.field(resting_field(pad))
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port)) as daemon:
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
            record(daemon)
            daemon.stop()
    with FirmwareHost(tmp_path, "--uid", OTHER) as other:
        other.field(resting_field(pad))
        ended = daemon.command("baseline", option, "--duration-s", "1", "--config", daemon.config)
    assert ended.returncode == 65, ended
    assert f"its baseline was recorded on board {ONE}" in ended.stderr


def test_baseline_without_board_id_is_accepted_with_note(tmp_path: Path, pad: Pad) -> None:
    with FirmwareHost(tmp_path) as host:
        host.field(resting_field(pad))
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port)) as daemon:
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
            record(daemon)
            daemon.stop()
            without_origin(file_of(daemon))
            daemon.start()
            daemon.wait_until_serving()
            daemon.wait_for(lambda contact: contact.health == "ok")
            assert "does not say on which board it was recorded" in daemon.log.read_text()


def without_origin(path: Path) -> None:
    """As another program may write it."""
    baseline = msgspec.json.decode(path.read_bytes(), type=Baseline)
    assert baseline.origin is not None
    path.write_bytes(encode(baseline.recorded_on(None)))
