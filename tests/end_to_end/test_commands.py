"""One-shot verbs as a person types them: beside a running daemon, without one, and with an obstacle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from end_to_end.processes import (
    BRIDGE_CONFIG,
    PATIENCE_S,
    FirmwareHost,
    RunningDaemon,
    resting_field,
    run_command,
)
from fmfts.bus.keys import KeyFolder
from fmfts.pad import Pad
from fmfts_client import RefusedError
from ports import tcp_base

# Neither pressed nor turned, so that a baseline may be recorded at any time.
STILL_CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
finger = "none"
turning_deg_per_s = 0.0
"""
RECORD = ("baseline", "--rest", "--duration-s", "0.5")


@pytest.fixture(params=["ipc", "tcp"])
def daemon(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningDaemon]:
    """Only the configuration says where it is, and over tcp a key."""
    endpoint, keys = f"ipc://{tmp_path}", None
    if request.param == "tcp":
        endpoint, keys = tcp_base(), tmp_path / "keys"
        KeyFolder(keys).add("test", tmp_path / "test.key", may_change=True)
        monkeypatch.setenv("FMFTS_KEY", str(tmp_path / "test.key"))
    with RunningDaemon(tmp_path, STILL_CONFIG, endpoint=endpoint, keys=keys) as daemon:
        yield daemon


def without_traceback(ended: subprocess.CompletedProcess[str], code: int) -> str:
    """The output of the command, which ended with `code` and a sentence."""
    assert "Traceback" not in ended.stderr
    assert ended.returncode == code, ended
    return ended.stderr + ended.stdout


def test_verbs_find_the_daemon_that_their_configuration_names(daemon: RunningDaemon) -> None:
    recorded = daemon.command(*RECORD, "--json", "--config", daemon.config)
    assert recorded.returncode == 0, recorded.stderr
    (pad,) = daemon.request("pads")["pads"]
    assert pad["baseline"] == json.loads(recorded.stdout)["baseline"], "the running daemon learned of it"
    for verb in (("probe",), ("selftest",), ("status",), ("listen", "--seconds", "0.5")):
        without_traceback(daemon.command(*verb, "--config", daemon.config), 0)
    without_traceback(daemon.command("status"), 69)


def test_second_daemon_is_refused_whatever_the_transport(daemon: RunningDaemon) -> None:
    said = without_traceback(daemon.command("run", "--config", daemon.config), 69)
    assert "another" in said
    assert daemon.base.removesuffix("/") in said


@pytest.mark.parametrize("verb", [("probe",), RECORD, ("status",), ("listen", "--seconds", "1")])
@pytest.mark.parametrize("place", ["nonsense", "open directory"])
def test_unusable_endpoint_is_reported_in_a_sentence(tmp_path: Path, verb: tuple[str, ...], place: str) -> None:
    (tmp_path / "fmfts").mkdir(mode=0o755)
    environment = os.environ | {
        "XDG_RUNTIME_DIR": str(tmp_path),
        "FMFTS_BUS": "nonsense" if place == "nonsense" else "",
    }
    config = tmp_path / "config.toml"
    config.write_text(STILL_CONFIG)
    said = without_traceback(run_command(*verb, "--config", config, environment=environment), 69)
    assert "FMFTS_BUS" in said or "ipc:///absolute/directory" in said


@pytest.mark.parametrize("verb", [("run",), RECORD])
def test_unusable_state_directory_is_reported_in_a_sentence(tmp_path: Path, verb: tuple[str, ...]) -> None:
    config = tmp_path / "config.toml"
    config.write_text(STILL_CONFIG)
    environment = os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}", "XDG_STATE_HOME": "/proc/x"}
    said = without_traceback(run_command(*verb, "--config", config, environment=environment), 73)
    assert "/proc/x" in said
    assert "XDG_STATE_HOME" in said


def test_duration_is_checked_without_a_daemon_too(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text(STILL_CONFIG)
    environment = os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}", "XDG_STATE_HOME": str(tmp_path)}
    arguments = ("baseline", "--rest", "--duration-s", "61", "--config", config)
    assert "0.5 to 60 s" in without_traceback(run_command(*arguments, environment=environment), 2)


@pytest.mark.parametrize("running", [True, False])
def test_pad_that_the_board_lacks_is_not_connected(tmp_path: Path, pad: Pad, running: bool) -> None:
    with FirmwareHost(tmp_path) as host:
        host.field(resting_field(pad))
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port) + "pad_index = 1\n") as daemon:
            daemon.wait_for(lambda contact: contact.health == "stale")
            if not running:
                daemon.stop()
            assert "connected: no" in without_traceback(daemon.command("probe", "--config", daemon.config), 69)


def test_wrong_request_lists_the_known_arguments(tmp_path: Path) -> None:
    with RunningDaemon(tmp_path, STILL_CONFIG) as daemon:
        assert daemon.request("baseline", rest=True, duration_s=0.5)["kind"] == "rest"
        with pytest.raises(RefusedError, match="one of rest, bare, turn, refine, posture, restore and undo_drift at"):
            daemon.request("baseline", rest=True, bare=True)
        with pytest.raises(RefusedError, match="no argument 'mode'; it takes pad, rest, bare, "):
            daemon.request("baseline", mode="rest")


def test_ctrl_c_also_ends_the_recording_in_the_daemon(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with RunningDaemon(tmp_path, STILL_CONFIG) as daemon:
        before = daemon.request("pads")["pads"][0]["baseline"]
        command = [sys.executable, "-m", "fmfts", "baseline", "--rest", "--duration-s", "60"]
        with subprocess.Popen(
            command, cwd=elsewhere, env=daemon.environment, stderr=subprocess.PIPE, text=True
        ) as recording:
            patient_until_s = time.monotonic() + PATIENCE_S
            while "being recorded already" not in refusal(daemon):
                assert time.monotonic() < patient_until_s
                time.sleep(0.05)
            recording.send_signal(signal.SIGINT)
            assert recording.communicate(timeout=PATIENCE_S)[1].endswith("stopped: nothing was recorded\n")
        assert recording.returncode == 130
        assert daemon.request("pads")["pads"][0]["baseline"] == before
        with pytest.raises(RefusedError, match="no baseline is being recorded; if one was stored just now"):
            daemon.request("baseline", stop=True)
        assert daemon.request("baseline", duration_s=0.5)["kind"] == "rest"


def refusal(daemon: RunningDaemon) -> str:
    """The daemon's answer to one more baseline with a duration of zero."""
    try:
        daemon.request("baseline", duration_s=0.0)
    except RefusedError as error:
        return str(error)
    return ""


class TestDamagedBaseline:
    @pytest.fixture
    def damaged(self, tmp_path: Path) -> Iterator[RunningDaemon]:
        """Two were recorded; the second was damaged while the daemon was down."""
        with RunningDaemon(tmp_path, STILL_CONFIG) as daemon:
            for _ in range(2):
                daemon.request("baseline", duration_s=0.5)
            daemon.stop()
            stored = tmp_path / "state" / "fmfts" / "baseline" / "left.json"
            stored.write_text(stored.read_text()[:300])
            daemon.start()
            daemon.wait_until_serving()
            yield daemon

    def test_bus_reports_missing_baseline_and_restores_the_last_good(self, damaged: RunningDaemon) -> None:
        without = damaged.wait_for(lambda contact: contact.health == "no_baseline")
        assert "left.json is damaged" in without.reason
        assert "left.previous.json" in without.reason
        assert "baseline --restore" in without.reason
        without_traceback(damaged.command("baseline", "--restore", "--config", damaged.config), 0)
        damaged.wait_for(lambda contact: contact.health == "ok")

    def test_last_good_baseline_is_restored_without_a_daemon(self, damaged: RunningDaemon) -> None:
        damaged.stop()
        without_traceback(damaged.command("baseline", "--restore", "--config", damaged.config), 0)
        damaged.start()
        damaged.wait_until_serving()
        damaged.wait_for(lambda contact: contact.health == "ok")
