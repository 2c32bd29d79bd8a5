"""Requests that take seconds, on a real control socket: each is answered, whatever becomes of the work."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq

from fmfts.baseline.files import path_of, previous_of, stored
from fmfts.bus.control import ControlServer
from fmfts.bus.publisher import Publisher
from fmfts.config import PadConfig, SceneConfig, SimulatedSource
from fmfts.contact import ContactModel
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.channel import Channel
from fmfts.runtime.kept import KeptAnswer
from fmfts.runtime.pending import PROGRESS_S
from fmfts.runtime.requests import Verbs
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor import Frame, Source
from fmfts.sensor.source import UNSETTLED_FRAMES
from fmfts.sensor.tasks import PATIENCE_S, SELFTEST_S
from fmfts_client import Endpoints
from fmfts_simulation.finger import steady_finger
from fmfts_simulation.source import Simulated

CONFIG = PadConfig(
    name="left", source=SimulatedSource(finger="none", turning_deg_per_s=0.0), scene=SceneConfig(ambient="constant")
)
PERIOD_NS = round(1e9 / 220)


class Broken(Executor):
    """Whatever is submitted ends with an error that nobody foresaw."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_exception(ZeroDivisionError("a bug"))
        return future


class Idle(Executor):
    """Whatever is submitted never ends."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        return Future()


class Daemon:
    """The part of one that handles requests, its pad's frames coming faster than in real time."""

    def __init__(self, folder: Path, executor: Executor) -> None:
        endpoints = Endpoints.from_base(f"ipc://{folder}")
        self._publisher = Publisher(endpoints, "boot")
        self._control = ControlServer(endpoints.control)
        self.source = Simulated(CONFIG)
        pad = CONFIG.pad()
        model = ContactModel.load("default", pad)
        pipeline = PadPipeline(pad, model, "boot", 220.0, tracking_model_for(CONFIG.scene, CONFIG.magnet).tracking)
        self.channel = Channel(self.source, 0, pipeline, self._publisher, "boot", 220.0)
        self.taken_back: list[Source] = []
        self.verbs = Verbs({"left": CONFIG}, [self.channel], executor, self.taken_back.append)
        self._now_ns = 0
        self.frames(1)
        self._peer = zmq.Context.instance().socket(zmq.DEALER)
        self._peer.linger = 0
        self._peer.connect(endpoints.control)

    def frames(self, count: int) -> list[Frame]:
        """The next `count` frames of the pad, which the channel has taken."""
        given = []
        while len(given) < count:
            for frame in self.source.poll(self._now_ns):
                given.append(replace(frame, host_time_ns=time.monotonic_ns()))
                self.channel.frame(given[-1])
            self._now_ns += PERIOD_NS
        return given

    def ask(self, verb: str, **arguments: Any) -> None:
        self.verbs.forget_kept()
        self._peer.send(msgpack.packb({"id": 1, "verb": verb, **arguments}))
        until = time.monotonic() + 60.0
        while not self._control.serve_one(self.verbs.handle):
            assert time.monotonic() < until

    def answer(self) -> dict[str, Any]:
        """The next message that the peer gets; jobs are finished until there is one."""
        until = time.monotonic() + 60.0
        while not self._peer.poll(10):
            self.verbs.finish_jobs()
            assert time.monotonic() < until
        answer: dict[str, Any] = msgpack.unpackb(self._peer.recv())
        return answer

    def result(self) -> dict[str, Any]:
        for _ in range(20):
            if "progress" not in (answer := self.answer()):
                return answer
        raise AssertionError("it never ends")

    def close(self) -> None:
        self._peer.close()
        self._control.close()
        self._publisher.close()


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "fmfts"


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    with ThreadPoolExecutor(max_workers=1) as executor:
        daemon = Daemon(tmp_path, executor)
        yield daemon
        daemon.close()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """Seconds that are added to this computer's clock."""
    ahead, real = [0.0], time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: real() + ahead[0])
    yield ahead
    ahead[0] = 0.0


def test_progress_comes_at_once_and_then_every_second(daemon: Daemon, clock: list[float]) -> None:
    daemon.ask("baseline", duration_s=55.0)
    assert daemon.answer() == {"id": 1, "progress": {"share": 0.0}}
    for second in range(1, 4):
        clock[0] += 2 * PROGRESS_S
        daemon.frames(220)
        assert daemon.answer()["progress"]["share"] == pytest.approx(second / 55, rel=0.05)


def test_recorded_baseline_is_in_use_before_it_is_reported(daemon: Daemon) -> None:
    daemon.ask("baseline", duration_s=1.0)
    daemon.frames(300)
    told = daemon.result()
    assert told["ok"]
    assert daemon.channel.pipeline.baseline is not None
    assert daemon.channel.pipeline.baseline.id == told["baseline"]
    assert stored(CONFIG.pad()) == daemon.channel.pipeline.baseline
    assert daemon.channel.job is None


def test_recording_that_is_stopped_ends_at_once_and_frees_next(daemon: Daemon) -> None:
    daemon.ask("baseline", duration_s=55.0)
    daemon.frames(100)
    daemon.ask("baseline", stop=True)
    assert daemon.channel.job is None
    assert daemon.result()["error"] == "pad 'left': no baseline was recorded: it was stopped"
    assert daemon.result() == {"id": 1, "ok": True, "pad": "left", "stopped": True}
    assert stored(CONFIG.pad()) is None
    daemon.ask("baseline", stop=True)
    assert "no baseline is being recorded; if one was stored just now" in daemon.result()["error"]
    daemon.ask("baseline", duration_s=1.0)
    daemon.frames(300)
    daemon.ask("baseline", stop=True)
    assert "no baseline is being recorded" in daemon.result()["error"], "it has frames enough: too late"
    assert daemon.result()["ok"]


@pytest.mark.parametrize("frames", [0, 100])
def test_pad_without_frames_fails_baseline_and_frees_next(daemon: Daemon, clock: list[float], frames: int) -> None:
    daemon.ask("baseline", duration_s=1.0)
    daemon.frames(frames)
    clock[0] += PATIENCE_S + 0.1
    assert "no frame within 3 s" in daemon.result()["error"]
    clock[0] = 0.0
    daemon.ask("baseline", duration_s=0.5)
    daemon.frames(150)
    assert daemon.result()["ok"]


def test_device_whose_clock_stands_fails_the_baseline(daemon: Daemon, clock: list[float]) -> None:
    daemon.ask("baseline", duration_s=1.0)
    (frame,) = daemon.frames(1)
    for number in range(8):
        clock[0] += 1.0
        daemon.channel.frame(replace(frame, sequence=frame.sequence + 1 + number))
    assert "is it halted" in daemon.result()["error"]


@pytest.mark.parametrize("leap_us", [-300_000, 2**20])
def test_board_whose_clock_leaps_fails_the_baseline(daemon: Daemon, leap_us: int) -> None:
    daemon.ask("baseline", duration_s=1.0)
    (before,) = daemon.frames(100)[-1:]
    daemon.channel.frame(replace(before, run=before.run + 1, device_time_us=before.device_time_us + leap_us))
    assert "leapt while recording" in daemon.result()["error"]
    assert daemon.channel.job is None


def test_vanished_device_is_named(daemon: Daemon, clock: list[float]) -> None:
    daemon.ask("baseline", duration_s=1.0)
    daemon.source.state.disconnect("unplugged", time.monotonic_ns())
    clock[0] += PATIENCE_S + 0.1
    assert re.fullmatch(r"pad 'left': no baseline was recorded: .*: unplugged", daemon.result()["error"])


def test_selftest_without_a_result_is_given_up(
    daemon: Daemon, clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(daemon.source, "selftest_result", lambda pad_index: None)
    daemon.ask("selftest")
    assert "progress" in daemon.answer()
    clock[0] += SELFTEST_S + 0.1
    assert daemon.result()["error"] == f"pad 'left': no self-test within {SELFTEST_S:g} s"


def test_unforeseen_error_is_an_answer_and_a_traceback(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    daemon = Daemon(tmp_path, Broken())
    daemon.ask("baseline", duration_s=0.5)
    daemon.frames(150)
    with caplog.at_level(logging.ERROR):
        assert "ZeroDivisionError: a bug" in daemon.result()["error"]
    assert "Traceback" in caplog.text
    daemon.ask("pads")
    assert daemon.answer()["ok"]
    daemon.close()


def test_unwritable_place_is_named_with_what_to_do(daemon: Daemon, state: Path) -> None:
    state.mkdir(parents=True)
    (state / "baseline").write_text("a file where a folder should be")
    daemon.ask("baseline", duration_s=0.5)
    daemon.frames(150)
    error = daemon.result()["error"]
    assert str(state / "baseline" / "left.json") in error
    assert "XDG_STATE_HOME" in error
    assert daemon.channel.pipeline.baseline is None


@pytest.mark.parametrize("duration_s", [0.4, 61.0, -1.0])
def test_senseless_duration_is_refused_with_the_limits(daemon: Daemon, duration_s: float) -> None:
    daemon.ask("baseline", duration_s=duration_s)
    assert "0.5 to 60 s" in daemon.answer()["error"]
    assert daemon.channel.job is None


def record_twice(daemon: Daemon) -> tuple[str, str]:
    ids = []
    for _ in range(2):
        daemon.ask("baseline", duration_s=0.5)
        daemon.frames(150)
        ids.append(daemon.result()["baseline"])
    first, second = ids
    return first, second


def test_restoring_swaps_the_last_two(daemon: Daemon) -> None:
    first, second = record_twice(daemon)
    for expected in (first, second, first):
        daemon.ask("baseline", restore=True)
        assert daemon.result()["baseline"] == expected
        assert daemon.channel.pipeline.baseline is not None
        assert daemon.channel.pipeline.baseline.id == expected


def test_damaged_file_never_replaces_the_previous_baseline(daemon: Daemon) -> None:
    first, _ = record_twice(daemon)
    path = path_of("left")
    kept = previous_of(path).read_bytes()
    path.write_bytes(path.read_bytes()[:300])
    daemon.ask("baseline", duration_s=0.5)
    daemon.frames(150)
    assert daemon.result()["ok"]
    assert previous_of(path).read_bytes() == kept
    daemon.ask("baseline", restore=True)
    assert daemon.result()["baseline"] == first


@pytest.mark.parametrize("kind", ["bare", "rest"])
def test_simulated_pad_is_held_for_its_baseline_and_then_let_go(daemon: Daemon, kind: str) -> None:
    daemon.source.finger = finger = steady_finger(2e-3, 1e-3, 1.0)
    daemon.frames(100)
    daemon.ask("baseline", duration_s=0.5, **{kind: True})
    assert daemon.source.mounted == (kind == "rest")
    daemon.frames(UNSETTLED_FRAMES)  # chips may still report earlier samples
    assert daemon.channel.job is not None
    assert daemon.channel.job._collection.frames == []
    daemon.frames(150)
    told = daemon.result()
    assert told["ok"]
    assert told["kind"] == kind
    if kind == "rest":
        assert told["remanence_t"] == pytest.approx(1.23, rel=0.2)  # the remanence of an untouched pad
        assert 5e-5 < told["middle_1n_place_sd_m"] < 5e-4
    daemon.verbs.finish_jobs()
    assert daemon.source.mounted
    assert daemon.source.finger is finger


def test_simulated_pad_is_let_go_where_its_baseline_is_refused(daemon: Daemon) -> None:
    finger = daemon.source.finger
    daemon.ask("baseline", turn=True)  # there is no baseline at rest
    assert "--rest" in daemon.result()["error"]
    assert daemon.source.finger is finger
    assert not daemon.source.tumbling


def test_restore_without_earlier_baseline_is_refused(daemon: Daemon) -> None:
    daemon.ask("baseline", restore=True)
    assert "left.previous.json" in daemon.result()["error"]


def test_probe_calls_a_pad_connected_only_while_frames_come(daemon: Daemon) -> None:
    daemon.ask("probe")
    (found,) = daemon.answer()["pads"]
    assert (found["connected"], found["reason"]) == (True, "")
    daemon.channel.tick(time.monotonic_ns() + 1_000_000_000)
    daemon.ask("probe")
    (found,) = daemon.answer()["pads"]
    assert not found["connected"]
    assert re.fullmatch(r"it is open, but none of its frames is used: silent for \d\.\d s", found["reason"])


def test_status_reports_present_health_with_its_reason(daemon: Daemon) -> None:
    channel = Channel(daemon.source, 0, daemon.channel.pipeline, daemon._publisher, "boot", 220.0)
    daemon.source.state.connected, daemon.source.state.reason = False, "it is being opened"
    fresh = channel.status(time.monotonic_ns())  # as it is published at start, before any message
    assert (fresh.health, fresh.reason) == ("disconnected", "simulated pad, seed 1: it is being opened")
    daemon.source.state.connected = True
    daemon.verbs.last_status["left"] = fresh
    daemon.ask("status")
    (told,) = daemon.answer()["pads"]
    assert (told["health"], told["connected"]) == (daemon.channel.health, True) == ("no_baseline", True)
    assert told["reason"]
    assert told["t_publish_ns"] == fresh.t_publish_ns


def fresh(daemon: Daemon, verb: str) -> Any:
    """The answer of verbs that have kept nothing."""
    with ThreadPoolExecutor(max_workers=1) as executor:
        verbs = Verbs({"left": CONFIG}, [daemon.channel], executor)
        verbs.last_status.update(daemon.verbs.last_status)
        return msgpack.unpackb(verbs._overview.of_all_pads(verb))


@pytest.mark.parametrize("verb", ["status", "pads", "probe"])
def test_kept_answer_equals_a_fresh_one(daemon: Daemon, verb: str) -> None:
    def changed_board() -> None:
        daemon.source.state.board["bus_0"] = {"errors": 1}

    def another_second() -> None:
        daemon.verbs.last_status["left"] = daemon.channel.status(time.monotonic_ns())

    another_second()
    for change in (
        lambda: None,
        lambda: daemon.frames(30),
        changed_board,
        lambda: daemon.source.state.sensor_faults.update({(0, 1): "sensor 2 is silent"}),
        lambda: daemon.source.state.disconnect("unplugged", time.monotonic_ns()),
        lambda: daemon.channel.tick(time.monotonic_ns() + 1_000_000_000),
        another_second,
    ):
        change()
        for _ in range(2):
            daemon.ask(verb)
            assert daemon.answer()["pads"] == fresh(daemon, verb)


def test_answer_is_encoded_once_until_its_facts_change() -> None:
    facts = {"left": [1.0], "right": [2.0]}
    kept = KeptAnswer(lambda: facts, lambda name: list(facts[name]))
    whole, left = kept.whole(), kept._pads["left"][1]
    facts["right"][0] = 3.0
    assert kept.whole() is whole, "until the loop's next turn"
    kept.forget()
    assert msgpack.unpackb(kept.whole()) == [[1.0], [3.0]]
    assert kept._pads["left"][1] is left


def test_only_changing_requests_take_frames_from_c(daemon: Daemon) -> None:
    """However often peers ask for a status, or for what is refused, C goes on with the frames."""
    for verb in ("status", "pads", "probe"):
        daemon.ask(verb)
        daemon.answer()
    for arguments in ({"pad": "nose"}, {"stop": True}, {"rest": True, "bare": True}, {"wrong": 1}):
        daemon.ask("baseline", **arguments)
        assert "error" in daemon.answer()
    assert not daemon.taken_back
    daemon.ask("baseline")
    assert daemon.taken_back == [daemon.source]


def test_second_selftest_of_a_pad_is_refused_while_one_runs(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(daemon.source, "selftest_result", lambda pad_index: None)
    daemon.ask("selftest")
    assert "progress" in daemon.answer()
    for _ in range(3):
        daemon.ask("selftest")
        assert daemon.result()["error"] == ("pad 'left': a self-test is running already: ask again when it has ended")
    assert len(daemon.verbs._pending) == 1


def test_second_restoration_of_a_pad_is_refused_while_one_runs(tmp_path: Path) -> None:
    with closing(Daemon(tmp_path, Idle())) as daemon:
        daemon.ask("baseline", restore=True)
        assert "progress" in daemon.answer()
        daemon.ask("baseline", restore=True)
        assert "a baseline is being restored already" in daemon.result()["error"]
