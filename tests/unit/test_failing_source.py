"""A source that raises anything, or returns anything, affects only that pad's health: the other pads continue, and it
recovers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from random import Random

import pytest
import zmq

from faulty_source import ERRORS, FRAMES, KINDS, Faulty
from fmfts.bus.encoding import decode_contact
from fmfts.bus.messages import ContactMessage
from fmfts.config import BusConfig, Config, PadConfig, ReplaySource, SimulatedSource
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime import daemon as running
from fmfts.runtime import guarded
from fmfts.runtime.daemon import Daemon
from fmfts.runtime.opening import open_guarded
from fmfts.sensor import SourceError
from fmfts.sensor.flaw import flaw_of
from fmfts.sources import Device, devices
from fmfts_simulation.source import Simulated

HEALTHY = ("a", "b", "c")
PATIENCE_S = 60.0
RECORDINGS = Path(__file__).parents[1] / "data" / "recordings"


def pad(name: str) -> PadConfig:
    return PadConfig(name=name, source=SimulatedSource(finger="none"))


@dataclass
class Bench:
    """A daemon with three healthy pads and a faulty one, and a subscriber to all of their contacts."""

    daemon: Daemon
    subscriber: zmq.Socket[bytes]
    fault: list[tuple[str, str] | None]
    heard: dict[str, list[ContactMessage]] = field(default_factory=dict)

    def until(self, wanted: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not wanted():
            assert time.monotonic() < end, "it never happened"
            self.daemon._turn()
            while self.subscriber.poll(0):
                _, payload = self.subscriber.recv_multipart()
                message = decode_contact(payload)
                self.heard.setdefault(message.pad, []).append(message)

    @property
    def last(self) -> ContactMessage:
        return self.heard["faulty"][-1]

    def hears(self, count: int) -> None:
        """Run until each healthy pad has published this many more messages."""
        wanted = {name: len(self.heard.get(name, ())) + count for name in HEALTHY}
        self.until(lambda: all(len(self.heard.get(name, ())) >= wanted[name] for name in HEALTHY))


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(guarded, "FIRST_PAUSE_S", 0.001)
    monkeypatch.setattr(guarded, "LONGEST_PAUSE_S", 0.01)
    fault: list[tuple[str, str] | None] = [None]
    faulty = Device({0: "faulty"}, partial(Faulty, pad("faulty"), lambda: fault[0], Random(40), 0.2), "a plug-in")
    monkeypatch.setattr(running, "devices", lambda pads: [*devices(pads[1:]), faulty])
    pads = tuple(map(pad, ("faulty", *HEALTHY)))
    context = zmq.Context.instance()
    with (
        Daemon(Config(pad=pads, bus=BusConfig(endpoint=f"ipc://{tmp_path}"))) as daemon,
        context.socket(zmq.SUB) as subscriber,
    ):
        subscriber.setsockopt(zmq.RCVHWM, 0)
        subscriber.setsockopt(zmq.LINGER, 0)
        subscriber.connect(f"ipc://{tmp_path}/bus")
        subscriber.subscribe(b"contact/")
        bench = Bench(daemon, subscriber, fault)
        bench.until(lambda: len(bench.heard) == 4 and bench.last.health == "ok")
        yield bench


def test_any_error_of_a_source_is_its_pads_health(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    for kind in ERRORS:
        bench.fault[0] = ("raises", kind)
        bench.until(lambda: bench.last.health == "disconnected")
        named = {"SourceError": "the device is on fire", "surrogates": "RuntimeError"}.get(kind, kind.split(".")[-1])
        assert named in bench.last.reason
        bench.fault[0] = None
        bench.until(lambda: bench.last.health == "ok")
    assert_others_went_on(bench)
    assert "Traceback" in caplog.text


def test_anything_that_a_source_returns_disturbs_no_other_pad(bench: Bench) -> None:
    (channel,) = (one for one in bench.daemon._channels.values() if one.name == "faulty")
    for kind in (kind for kind in KINDS if kind[0] != "raises"):
        number, bench.fault[0] = bench.last.seq, kind
        bench.hears(3)
        if kind[0] in ("clock_line", "lendable", "lend"):
            bench.until(lambda kind=kind: f"internal error in {kind[0]}: " in bench.last.reason)
        bench.fault[0] = None
        bench.until(lambda number=number: bench.last.health == "ok" and bench.last.seq > number)
    assert_others_went_on(bench)
    dropped, (frame,) = channel._statistics.dropped, Simulated(pad("faulty")).poll(10**9)
    channel.frame(replace(frame, temperature_c=float("nan")))
    assert channel._statistics.dropped == dropped + 1
    assert "a frame's temperature is nan" in channel.status(time.monotonic_ns()).sensor_faults


def assert_others_went_on(bench: Bench) -> None:
    """Each frame that was not late is published, and only this computer's lateness disturbed it.

    A message that was late when it was made keeps its number.
    """
    for channel in bench.daemon._channels.values():
        if channel.name == "faulty":
            continue
        heard = bench.heard[channel.name]
        healths = {(message.health, message.reason) for message in heard}
        assert {health for health, reason in healths if "overloaded" not in reason} == {"ok"}
        numbers = [message.seq for message in heard]
        assert numbers[-1] - numbers[0] + 1 - len(numbers) <= channel._statistics.dropped


def test_each_flaw_of_a_frame_is_named() -> None:
    source = Simulated(pad("left"))
    (frame,) = source.poll(10**9)
    sensors, now_ns = len(frame.counts), frame.host_time_ns
    assert flaw_of(frame, sensors, now_ns) == ""
    for kind, change in FRAMES.items():
        changed = change([frame])
        if kind.split()[0] in ("None", "no", "endless", "2,000", "another", "pad_index"):
            continue  # a poll that returns anything but frames of its pads is an error of the source
        assert isinstance(changed, list)
        assert flaw_of(changed[0], sensors, now_ns).startswith("a frame"), kind


def test_missing_recording_is_its_pads_health(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(guarded, "FIRST_PAUSE_S", 0.001)
    monkeypatch.setattr(guarded, "LONGEST_PAUSE_S", 0.01)
    path = tmp_path / "away.mcap"
    away = PadConfig(name="played", source=ReplaySource(file=str(path), pad="left", loop=True))
    with Daemon(Config(pad=(away, pad("a")), bus=BusConfig(endpoint=f"ipc://{tmp_path}"))) as daemon:
        played, simulated = daemon._channels.values()
        run(daemon, lambda: simulated.health == "ok" and played.announcer.last is not None)
        assert played.health == "disconnected"
        assert "away.mcap" in played.told()[1]
        path.write_bytes(b"[" * 100_000)
        run(daemon, lambda: "is not a recording" in played.told()[1])
        (tmp_path / "taps.mcap").write_bytes((RECORDINGS / "taps.mcap").read_bytes())
        (tmp_path / "taps.mcap").rename(path)
        run(daemon, lambda: played.health == "ok")
        assert simulated.health == "ok"
        assert isinstance(played.source, guarded.GuardedSource)
        assert isinstance(played.pipeline, PadPipeline)
        baselined = played.pipeline.baselined
        played.source.fail("poll", SourceError("read it again"))
        run(daemon, lambda: played.health == "disconnected")
        run(daemon, lambda: played.health == "ok")
        assert played.pipeline.baselined is baselined, "a new one takes 15 ms, in which the other pads wait"


def run(daemon: Daemon, until: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < end, "it never happened"
        daemon._turn()


def test_daemon_whose_only_recording_is_away_does_not_start(tmp_path: Path) -> None:
    away = PadConfig(name="played", source=ReplaySource(file=str(tmp_path / "away.mcap")))
    with pytest.raises(SourceError, match=r"away\.mcap"):
        open_guarded(devices((away,)))
