"""One cause has one exit code, with every verb, with a running daemon or without."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from end_to_end.processes import BRIDGE_CONFIG, FirmwareHost, RunningDaemon
from fmfts.common import exit_codes
from fmfts_client import RefusedError


@pytest.fixture
def daemon(tmp_path: Path, host: FirmwareHost) -> Iterator[RunningDaemon]:
    with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port)) as daemon:
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
        yield daemon


def code(daemon: RunningDaemon, *words: str | Path) -> int:
    ended = daemon.command(*words, "--config", daemon.config)
    assert "Traceback" not in ended.stderr, ended.stderr
    return ended.returncode


def test_probe_succeeds_only_if_every_sensor_can_be_used(host: FirmwareHost, daemon: RunningDaemon) -> None:
    assert code(daemon, "probe") == exit_codes.DONE
    for sensor in range(4):
        host.tell(f"fault 0 {sensor} unplugged")
    daemon.wait_for(lambda contact: contact.sensors_ok == 0)
    found = daemon.command("probe", "--config", daemon.config)
    assert found.returncode == exit_codes.FAULTY
    assert "connected: yes\nsound: no\n" in found.stdout
    daemon.stop()
    assert code(daemon, "probe") == exit_codes.FAULTY
    for sensor in range(3):
        host.tell(f"fault 0 {sensor} none")
    assert code(daemon, "probe") == exit_codes.FAULTY  # one of them no longer moves
    host.tell("fault 0 3 none")
    assert code(daemon, "probe") == exit_codes.DONE


def test_unknown_pad_and_option_out_of_range_are_usage(daemon: RunningDaemon, tmp_path: Path) -> None:
    assert code(daemon, "listen", "--pad", "lef") == exit_codes.USAGE
    assert code(daemon, "record", tmp_path / "a.mcap", "--pad", "lef") == exit_codes.USAGE
    assert code(daemon, "selftest", "--pad", "lef") == exit_codes.USAGE
    for verb in ("baseline", "selftest"):
        with pytest.raises(RefusedError, match="did you mean 'left'") as refused:
            daemon.request(verb, pad="lef")
        assert refused.value.code == exit_codes.USAGE
    assert code(daemon, "baseline", "--rest", "--duration-s", "61") == exit_codes.USAGE


def test_state_that_cannot_be_written_is_unwritable(daemon: RunningDaemon) -> None:
    place = daemon.folder / "state" / "fmfts" / "baseline"
    shutil.rmtree(place, ignore_errors=True)
    place.write_text("a file where a folder should be")
    baseline = ("baseline", "--rest", "--duration-s", "1")
    assert code(daemon, *baseline) == exit_codes.UNWRITABLE
    daemon.stop()
    assert code(daemon, *baseline) == exit_codes.UNWRITABLE


def test_unplugged_board_is_absent(host: FirmwareHost, daemon: RunningDaemon) -> None:
    verbs = [("selftest",), ("baseline", "--rest"), ("probe",)]
    host.kill()
    daemon.wait_for(lambda contact: contact.health == "disconnected")
    assert {verb: code(daemon, *verb) for verb in verbs} == dict.fromkeys(verbs, exit_codes.UNAVAILABLE)
    daemon.stop()
    assert {verb: code(daemon, *verb) for verb in verbs} == dict.fromkeys(verbs, exit_codes.UNAVAILABLE)
