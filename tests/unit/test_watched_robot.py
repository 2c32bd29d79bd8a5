"""How the page of the fleet judges robots: over real sockets, whose time the tests tell. With daemons: end_to_end/."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import msgpack
import msgspec
import pytest
import zmq
from test_cli import without

from fmfts.bus.messages import Health
from fmfts.bus.publisher import Publisher
from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts_client import Endpoints, Status
from fmfts_fleet.pad_health import WORST_FIRST, PadHealth, facts_of
from fmfts_fleet.robots import FIRST_S, MOST_PADS, SILENT_S, WatchedRobot
from ports import tcp_base, wait_until_free
from unit.bus_messages import BOOT, status_message

PATIENCE_S = 60.0


def status(name: str = "left", **changes: Any) -> dict[str, Any]:
    """A status as a client receives it."""
    return dict(msgspec.to_builtins(status_message(pad=name))) | changes


def pad(name: str = "left", **changes: Any) -> PadHealth:
    return PadHealth.of(Status.from_message(status(name, **changes)))


class TestWorstPad:
    def test_every_word_of_health_has_its_place(self) -> None:
        assert set(WORST_FIRST) == set(get_args(Health))

    def test_worst_pad_is_the_least_useful_one(self) -> None:
        pads = [pad(health, health=health, reason="") for health in reversed(WORST_FIRST)]
        for health in WORST_FIRST[:-1]:
            facts = facts_of(pads)
            assert facts["worst"]["health"] == health
            assert next(iter(facts["health"])) == health
            pads = [each for each in pads if each.health != health]
        assert facts_of(pads)["worst"] is None, "ok is nothing to worry about"

    def test_ok_pad_with_a_reason_ranks_below_one_without(self) -> None:
        overloaded = pad("right", reason="this computer is overloaded: 37 % of the frames left out")
        assert facts_of([pad(), overloaded])["worst"]["pad"] == "right"
        assert facts_of([pad(), pad("right", sensor_faults=["sensor 3 is silent"])])["worst"]["pad"] == "right"

    def test_rate_is_that_of_the_slowest_pad_relative_to_nominal(self) -> None:
        facts = facts_of([pad(rate_hz=99.0, rate_nominal_hz=100.0), pad("right", rate_hz=110.0, rate_nominal_hz=220.0)])
        assert (facts["rate_hz"], facts["rate_nominal_hz"]) == (110.0, 220.0)

    def test_unknown_health_is_shown_and_not_ok(self) -> None:
        assert facts_of([pad(), pad("right", health="enchanted")])["worst"]["health"] == "enchanted"

    def test_duration_is_counted_on_the_daemons_clock(self) -> None:
        facts = facts_of([pad(health="stale", since_ns=5_000_000_000, t_publish_ns=65_000_000_000)])
        assert facts["worst"]["for_s"] == 60.0

    def test_texts_of_a_robot_are_limited(self) -> None:
        shown = pad(reason="x" * 10_000, sensor_faults=["y" * 10_000] * 100)
        assert len(shown.reason) + sum(map(len, shown.sensor_faults)) < 10_000


class Rig:
    """A robot that is watched, and the bus of its daemon. `now_s` is the watcher's time."""

    def __init__(self, base: str, is_served: bool = True) -> None:
        self.endpoints = Endpoints.from_base(base)
        self.now_s = 100.0
        self.publisher = Publisher(self.endpoints, BOOT) if is_served else None
        self.robot = WatchedRobot("arm", self.endpoints, self.now_s)

    def facts(self) -> dict[str, Any]:
        self.robot.look(self.now_s)
        return self.robot.facts(self.now_s)

    def until(self, **wanted: Any) -> dict[str, Any]:
        """The facts, once they are as wanted; the daemon meanwhile sends nothing of itself."""
        end = time.monotonic() + PATIENCE_S
        while not wanted.items() <= (facts := self.facts()).items():
            assert time.monotonic() < end, facts
            time.sleep(0.01)
        return facts

    def sent(self, *messages: Any, **wanted: Any) -> dict[str, Any]:
        """Send these statuses again and again, until the facts are as wanted."""
        end = time.monotonic() + PATIENCE_S
        while not wanted.items() <= (facts := self.facts()).items():
            assert time.monotonic() < end, facts
            assert self.publisher is not None
            for message in messages:
                self.publisher.send_status(message.pad, message)
            time.sleep(0.01)
        return facts

    def stop_daemon(self) -> None:
        if self.publisher is not None:
            self.publisher.close()
            self.publisher = None
            if self.endpoints.bus.startswith("tcp:"):
                wait_until_free(self.endpoints.bus)

    def close(self) -> None:
        self.stop_daemon()
        self.robot.close()


@pytest.fixture(params=["ipc", "tcp"])
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    rig = Rig(f"ipc://{tmp_path}" if request.param == "ipc" else tcp_base())
    yield rig
    rig.close()


def test_robot_waits_then_is_there_then_lost_then_there_again(rig: Rig) -> None:
    assert rig.facts()["state"] == "waiting"
    facts = rig.sent(status_message(), state="there")
    assert (facts["pads"], facts["health"], facts["why"]) == (1, {"ok": 1}, "")
    rig.stop_daemon()
    facts = rig.until(state="lost")
    assert facts["since_s"] == 0.0
    assert facts["why"].startswith(f"no daemon at {rig.endpoints.bus}: is ")
    assert "fmfts-daemon running" in facts["why"]
    assert (facts["pads"], facts["rate_hz"], facts["health"], facts["worst"]) == (1, None, {}, None)
    rig.now_s += 7.0
    assert rig.facts()["since_s"] == 7.0
    rig.publisher = Publisher(rig.endpoints, "another")
    rig.sent(status_message(boot="another"), state="there")


def test_robot_that_never_answers_is_not_reached_and_says_what_to_do(tmp_path: Path) -> None:
    rig = Rig(f"ipc://{tmp_path}", is_served=False)
    assert rig.facts()["state"] == "waiting"
    rig.now_s += FIRST_S
    assert rig.facts()["state"] == "unreached"
    assert "is fmfts-daemon running" in rig.facts()["why"]
    rig.close()


def test_daemon_with_a_stopped_loop_is_lost_despite_its_connection(rig: Rig) -> None:
    rig.sent(status_message(), state="there")
    for _ in range(30):  # until nothing that was sent is on its way
        rig.facts()
        time.sleep(0.01)
    rig.now_s += SILENT_S - 0.1
    assert rig.facts()["state"] == "there"
    rig.now_s += 0.2
    facts = rig.facts()
    assert facts["state"] == "lost"
    assert "says nothing of any pad" in facts["why"]
    assert "journalctl -u fmfts" in facts["why"]
    rig.sent(status_message(), state="there")


def test_restarted_daemon_has_only_pads_of_its_new_configuration(rig: Rig) -> None:
    rig.sent(status_message(pad="left"), status_message(pad="right"), state="there", pads=2)
    rig.sent(status_message(pad="thumb", boot="another"), pads=1)


def test_another_schema_version_is_reported(rig: Rig) -> None:
    rig.robot.look(rig.now_s)
    end = time.monotonic() + PATIENCE_S
    while "sends schema version 2" not in rig.facts()["why"]:
        assert time.monotonic() < end, rig.facts()
        assert rig.publisher is not None
        rig.publisher.send_status("demo", status_message(v=2))
        rig.now_s += 0.1
        time.sleep(0.01)
    assert rig.facts()["state"] == "unreached"


def test_pads_beyond_the_most_are_not_kept(rig: Rig) -> None:
    many = [status_message(pad=f"p{number}") for number in range(MOST_PADS + 20)]
    rig.sent(*many, state="there", pads=MOST_PADS)
    for _ in range(5):
        time.sleep(0.01)
        assert rig.facts()["pads"] == MOST_PADS


def test_only_statuses_are_asked_of_a_daemon(tmp_path: Path) -> None:
    endpoints = Endpoints.from_base(f"ipc://{tmp_path}")
    bus: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.XPUB)
    bus.bind(endpoints.bus)
    robot = WatchedRobot("arm", endpoints, 0.0)
    assert bus.poll(60_000)
    assert bus.recv() == b"\x01status/"
    assert not bus.poll(300)
    bus.send_multipart([b"status/left", msgpack.packb({"v": 1, "pad": "left"})])  # a message that is not a status
    time.sleep(0.1)
    robot.look(0.1)
    assert robot.facts(0.1)["pads"] == 0
    robot.close()
    bus.close(0)


class TestCommandLine:
    @pytest.mark.parametrize(
        ("words", "code", "said"),
        [
            (["--robot", "arm"], exit_codes.USAGE, "give NAME=ENDPOINT, such as arm=tcp://"),
            (["--robot", "der Arm=tcp://127.0.0.1:5570"], exit_codes.USAGE, "a name is 1 to 32 letters"),
            (["--robot", "../x=tcp://127.0.0.1:5570"], exit_codes.USAGE, "a name is 1 to 32 letters"),
            (["--robot", "arm=127.0.0.1"], exit_codes.UNAVAILABLE, "'127.0.0.1' is not a base of endpoints"),
            (["--robot", "a=tcp://h:1", "--robot", "a=tcp://h:5"], exit_codes.USAGE, "there is a robot 'a' already"),
            (["--robot", "a=tcp://h:1", "--foxglove"], exit_codes.USAGE, "--foxglove is for one robot"),
            (["--robot", "a=tcp://h:1", "--fixed-baseline"], exit_codes.USAGE, "--fixed-baseline is for one robot"),
            (["--robot-keys", "keys"], exit_codes.USAGE, "--robot-keys is for --robot"),
            (
                ["--robot", "arm=tcp://192.0.2.1:5570"],
                exit_codes.CONFIG,
                "robot 'arm': tcp://192.0.2.1:5570 is on",
            ),
        ],
    )
    def test_impossible_options_are_refused_before_serving(
        self,
        words: list[str],
        code: int,
        said: str,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.delenv("FMFTS_KEY", raising=False)
        assert main(["view", "--port", "0", *words]) == code
        assert said in capsys.readouterr().err

    def test_package_not_installed_is_named_with_how_to_install_it(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        without(monkeypatch, "fmfts.views")
        assert main(["view", "--port", "0", "--robot", "arm=tcp://127.0.0.1:5570"]) == exit_codes.LACKING
        said = capsys.readouterr().err
        assert "view --robot belongs to a package of its own" in said
        assert "pip install 'fmfts[fleet]' -e " in said

    def test_key_that_is_missing_is_named_with_how_to_make_it(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        words = ["--robot", "arm=tcp://127.0.0.1:5570", "--robot-keys", str(tmp_path)]
        assert main(["view", "--port", "0", *words]) == exit_codes.CONFIG
        said = capsys.readouterr().err
        assert f"there is no {tmp_path}/arm.key" in said
        assert "`fmfts-daemon keys new CLIENT -o arm.key`" in said

    def test_key_that_others_may_read_is_refused(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        (tmp_path / "arm.key").write_text("")
        (tmp_path / "arm.key").chmod(0o644)
        words = ["--robot", "arm=tcp://127.0.0.1:5570", "--robot-keys", str(tmp_path)]
        assert main(["view", "--port", "0", *words]) == exit_codes.CONFIG
        assert f"robot 'arm': key {tmp_path}/arm.key is open to others" in capsys.readouterr().err
