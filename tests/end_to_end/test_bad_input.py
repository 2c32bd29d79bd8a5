"""Mistakes of users: the configuration, no device, a second daemon, invalid requests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgpack
import numpy as np
import pytest
import zmq

from end_to_end.processes import BRIDGE_CONFIG, PATIENCE_S, FirmwareHost, RunningDaemon, resting_field, run_command
from fmfts.pad import Pad
from fmfts_client import Contact

SIMULATED_CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
"""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDaemon]:
    """On a simulated pad; no test changes its state."""
    with RunningDaemon(tmp_path_factory.mktemp("daemon"), SIMULATED_CONFIG) as daemon:
        yield daemon


@pytest.mark.parametrize(
    ("line", "told"),
    [
        pytest.param("rate_hertz = 220\n", ["{path}", "rate_hertz", "rate_hz"], id="unknown key, and the nearest"),
        pytest.param("rate_hz = 500\n", ["rate_hz", "220"], id="value out of range, and the limit"),
        pytest.param('[pad.contact]\nmodel = "nothing.onnx"\n', ["nothing.onnx"], id="absent model"),
    ],
)
def test_wrong_configuration_exits_with_78_and_names_the_key(tmp_path: Path, line: str, told: list[str]) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(SIMULATED_CONFIG + line)
    ended = run_command("run", "--config", path)
    assert ended.returncode == 78
    assert all(word.format(path=path) in ended.stderr for word in told), ended.stderr


class TestNoDevice:
    @pytest.mark.parametrize("verb", [("probe",), ("selftest",), ("baseline", "--rest")])
    def test_one_shot_verbs_end_with_69(self, tmp_path: Path, verb: tuple[str, ...]) -> None:
        path = tmp_path / "config.toml"
        path.write_text(BRIDGE_CONFIG.format(port=tmp_path / "nothing"))
        ended = run_command(*verb, "--config", path)
        assert ended.returncode == 69, ended
        assert "nothing" in ended.stderr + ended.stdout

    def test_run_waits_and_starts_when_the_device_appears(self, tmp_path: Path, pad: Pad) -> None:
        port = tmp_path / "board"
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=port)) as daemon:
            absent = daemon.wait_for(lambda contact: contact.health == "disconnected")
            assert str(port) in absent.reason
            assert absent.pose is None
            assert absent.contact is None
            with FirmwareHost(tmp_path) as host:
                host.field(resting_field(pad))
                absences = 0

                def came(contact: Contact) -> bool:
                    nonlocal absences
                    absences += "does not exist" in contact.reason
                    return contact.health == "no_baseline"

                daemon.wait_for(came)
                # It says so ten times a second, and tries to open the port at least once a second.
                assert absences < 15

    def test_silence_is_reported_ten_times_a_second(self, tmp_path: Path) -> None:
        with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=tmp_path / "nothing")) as daemon:
            daemon.wait_for(lambda contact: contact.health == "disconnected")
            told_ns: list[int] = []
            with daemon.subscribe() as messages:
                while len(told_ns) < 21:
                    message = messages.receive(PATIENCE_S)
                    assert message is not None
                    told_ns.append(message.body["t_publish_ns"])
        assert np.median(np.diff(told_ns)) <= 0.105e9  # by its own clock; a busy computer delays single ones


def test_second_daemon_on_endpoint_is_refused_with_firsts_pid(daemon: RunningDaemon) -> None:
    second = daemon.command("run", "--config", daemon.config)
    assert second.returncode == 69
    assert str(daemon.process.pid) in second.stderr
    daemon.wait_for(lambda contact: contact.health == "ok")


@pytest.mark.parametrize(
    "request_body",
    [
        b"",
        b"\xc1",
        msgpack.packb([1, 2, 3]),
        msgpack.packb({"id": 1}),
        msgpack.packb({"id": 1, "verb": "explode"}),
        msgpack.packb({"id": 1, "verb": "baseline", "pad": 7}),
        msgpack.packb({"id": 1, "verb": "baseline", "pad": "right"}),
        msgpack.packb({"id": 1, "verb": "baseline", "duration_s": float("nan")}),
        msgpack.packb({"id": 1, "verb": "baseline", "duration_s": 1e9}),
        msgpack.packb({"id": 1, "verb": "status", "surplus": True}),
        msgpack.packb({"id": 1, "verb": "selftest", "path": "/etc/passwd"}),
    ],
)
def test_malformed_request_gets_an_error_and_changes_nothing(daemon: RunningDaemon, request_body: bytes) -> None:
    before = daemon.request("pads")
    with zmq.Context.instance().socket(zmq.DEALER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(f"{daemon.base}/control")
        socket.send(request_body)
        assert socket.poll(PATIENCE_S * 1e3)
        answer = msgpack.unpackb(socket.recv())
    assert answer["error"]
    assert "ok" not in answer
    assert daemon.request("pads") == before
