"""A pad with one magnet on a hand that moves, frame by frame in C: taught, untouched, pressed, without joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from emulator.hand_magnets import HandMagnets
from fmfts.baseline import Baseline, make_bare, make_rest, summarise
from fmfts.baseline.posture import PostureLearner
from fmfts.baseline.request import POSTURE_DROPPED, BaselineRequest
from fmfts.bus.messages import ContactMessage
from fmfts.config import Config, PadConfig, SceneConfig, SimulatedSource
from fmfts.config.checks import problems_in
from fmfts.pipeline.configured import contact_model_of, pipeline_of, posture_learner
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor import Frame
from fmfts_simulation.finger import Finger, no_finger
from fmfts_simulation.hands import PressesAllOver
from fmfts_simulation.source import Simulated

PERIOD_NS = 1_000_000_000 // 220
JOINTS_EVERY = 4  # frames


def config(ambient: str = "posture", seed: int = 5) -> PadConfig:
    scene = msgspec.convert({"ambient": ambient}, SceneConfig)
    return PadConfig(name="left", source=SimulatedSource(seed=seed, turning_deg_per_s=0.0), scene=scene)


@dataclass
class World:
    """A simulated pad past which a hand moves. now_ns: of the last poll."""

    source: Simulated
    hand: HandMagnets
    now_ns: int = 1_000_000_000

    @classmethod
    def still(cls, seed: int, moment_am2: float) -> World:
        source = Simulated(config(seed=seed))
        source.finger = no_finger
        world = cls(source, HandMagnets(moment_am2, since_s=1e9))
        world.source.neighbours.append(world.hand)  # type: ignore[arg-type]
        return world

    def move(self) -> None:
        self._since(self.source.time_s)

    def rest(self) -> None:
        self._since(1e9)

    def _since(self, time_s: float) -> None:
        self.hand = replace(self.hand, since_s=time_s)
        self.source.neighbours[-1] = self.hand  # type: ignore[assignment]

    def frames(self, seconds: float) -> Iterator[Frame]:
        for _ in range(round(seconds * 220)):
            self.now_ns += PERIOD_NS
            yield from self.source.poll(self.now_ns)

    def joints_rad(self, time_ns: int) -> dict[str, float]:
        return self.hand.joints_rad((time_ns - 1_000_000_000 - PERIOD_NS) * 1e-9)


def rested(world: World) -> Baseline:
    pad, tolerance = config().pad(), config().tolerance.si()
    world.source.mounted = False
    bare = make_bare(pad, tolerance, summarise(list(world.frames(3.0))))
    world.source.mounted = True
    return make_rest(pad, tolerance, summarise(list(world.frames(3.0))), bare)[0]


@cache
def taught(seed: int, moment_am2: float) -> tuple[World, Baseline, Baseline, dict[str, object]]:
    """The world after a minute of motion, the rest before it, and what it taught."""
    world = World.still(seed, moment_am2)
    before = rested(world)
    world.move()
    frames = list(world.frames(60.0))
    learner = PostureLearner()
    for frame in frames[::JOINTS_EVERY]:
        learner.track.take(world.joints_rad(frame.host_time_ns), frame.host_time_ns)
    baseline, _, facts = learner.make(config().pad(), frames, before)
    return world, before, baseline, facts


def pipeline_with(baseline: Baseline, ambient: str = "posture") -> PadPipeline:
    made = pipeline_of(config(ambient), contact_model_of(config(ambient)), "boot")
    assert isinstance(made, PadPipeline)
    made.use(baseline)
    return made


def told(
    world: World, pipeline: PadPipeline, seconds: float, finger: Finger = no_finger, joints: bool = True
) -> list[tuple[ContactMessage, tuple[float, float, float]]]:
    """Messages, and what the finger really did."""
    world.source.finger = finger
    out = []
    for number, frame in enumerate(world.frames(seconds)):
        if joints and pipeline.hand is not None and number % JOINTS_EVERY == 0:
            then_ns = frame.host_time_ns - 4_000_000
            pipeline.hand.take(world.joints_rad(then_ns), then_ns)
        out.append((pipeline.process(frame), world.source.truth(frame.host_time_ns)))
    return out


def healths(messages: list[tuple[ContactMessage, tuple[float, float, float]]]) -> Counter[str]:
    return Counter(message.health for message, _ in messages)


@pytest.mark.parametrize("moment_am2", [0.005, 0.02])
def test_untouched_moving_hand_is_ok_and_touches_nothing(moment_am2: float) -> None:
    world, before, baseline, facts = taught(5, moment_am2)
    unaware = told(world, pipeline_with(before, "drifting"), 8.0)
    aware = told(world, pipeline_with(baseline), 8.0)
    assert healths(unaware)["disturbed"] > 0.3 * len(unaware)
    assert healths(aware)["ok"] > 0.99 * len(aware), Counter(message.reason for message, _ in aware)
    assert not any(message.contact for message, _ in aware)
    assert facts["posture_left_t"] < 0.05 * facts["posture_uneven_t"]  # type: ignore[operator]


def test_presses_on_a_moving_hand_are_found_and_not_wrong() -> None:
    world, _, baseline, _ = taught(5, 0.005)
    messages = told(world, pipeline_with(baseline), 20.0, PressesAllOver(world.source.time_s))
    pressed = [(message, truth) for message, truth in messages if truth[2] > 0.28]
    found = [(message, truth) for message, truth in pressed if message.contact and message.force_n is not None]
    assert len(found) > 0.95 * len(pressed)
    assert not any(message.contact for message, truth in messages if truth[2] == 0.0)
    for message, (x_m, y_m, force_n) in found:
        assert abs(message.force_n - force_n) < 5.0 * message.force_sd_n  # type: ignore[operator]
        if message.x_m is not None:
            assert abs(message.x_m - x_m) < 5.0 * message.x_sd_m  # type: ignore[operator]
            assert abs(message.y_m - y_m) < 5.0 * message.y_sd_m  # type: ignore[operator]


def test_joints_that_stop_are_named_and_widen() -> None:
    world, _, baseline, _ = taught(5, 0.005)
    pipeline = pipeline_with(baseline)
    known = told(world, pipeline, 2.0)[-1][0]
    silent = told(world, pipeline, 2.0, joints=False)
    assert known.health == "ok"
    assert known.pose is not None
    late = [message for message, _ in silent[-200:]]
    assert all("joint positions stopped arriving" in message.reason for message in late)
    assert {message.health for message in late} <= {"degraded", "lost", "disturbed"}
    assert not any(message.contact for message in late)
    seen = [message.pose.position_sd_m[2] for message in late if message.pose is not None]
    assert all(deviation > 1.5 * known.pose.position_sd_m[2] for deviation in seen)
    assert told(world, pipeline, 1.0)[-1][0].health == "ok"


def test_pad_without_a_recorded_posture_says_what_to_do() -> None:
    world, before, _, _ = taught(5, 0.005)
    message = told(world, pipeline_with(before), 0.1)[-1][0]
    assert message.health in ("degraded", "disturbed", "lost")
    assert "was not taught: `fmfts-daemon baseline --posture`" in message.reason


def test_rest_recorded_again_keeps_the_posture_with_its_joints() -> None:
    world, _, baseline, _ = taught(5, 0.005)
    world.rest()
    pad, tolerance = config().pad(), config().tolerance.si()
    frames = list(world.frames(3.0))
    request = BaselineRequest(pad, tolerance, bare=False, replaced=False)
    unknown, _ = request.make(frames, baseline)
    assert unknown.posture is not None
    assert unknown.posture.rest_unknown
    for frame in frames:
        request.joints.take(world.joints_rad(frame.host_time_ns), frame.host_time_ns)
    known, _ = request.make(frames, baseline)
    assert known.posture is not None
    assert known.posture.rest_rad == pytest.approx(
        [world.joints_rad(0)[name] for name in ("knuckle", "middle", "still")]
    )
    assert all(message.health == "ok" for message, _ in told(world, pipeline_with(known), 1.0)[20:])
    message = told(world, pipeline_with(unknown), 0.2)[-1][0]
    assert "the joints of the rest recording are not known" in message.reason
    world.move()


def test_bare_baseline_says_that_it_drops_the_posture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The posture is relative to the rest, which a bare recording drops, too."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world, before, baseline, _ = taught(5, 0.005)
    pad, tolerance = config().pad(), config().tolerance.si()
    world.rest()
    world.source.mounted = False
    frames = list(world.frames(3.0))
    world.source.mounted = True
    world.move()
    request = BaselineRequest(pad, tolerance, bare=True, replaced=False)
    assert POSTURE_DROPPED not in request.record(frames, before).facts(pad)["warnings"]
    recorded = request.record(frames, baseline)
    assert recorded.baseline.posture is None
    assert POSTURE_DROPPED in recorded.facts(pad)["warnings"]


def test_pad_without_posture_has_no_hand_and_the_same_messages() -> None:
    world, before, baseline, _ = taught(5, 0.005)
    frames = list(world.frames(1.0))
    one, other = pipeline_with(before, "drifting"), pipeline_with(baseline, "drifting")
    assert one.hand is None
    for frame in frames:
        first, second = one.process(frame), other.process(frame)
        assert (first.health, first.pose, first.force_n) == (second.health, second.pose, second.force_n)


def test_posture_is_recorded_only_with_a_posture_scene() -> None:
    from fmfts.baseline import BaselineError

    with pytest.raises(BaselineError, match='ambient = "posture"'):
        posture_learner(config("drifting"))
    assert posture_learner(config()).seconds == 60.0


def test_configuration_refuses_keys_that_a_moving_hand_lacks() -> None:
    pad = config()
    drifting = msgspec.structs.replace(pad, rebaseline=msgspec.structs.replace(pad.rebaseline, enabled=True))
    assert not problems_in(Config(pad=[pad]))
    assert [keys for keys, _ in problems_in(Config(pad=[drifting]))] == [("pad", 0, "rebaseline", "enabled")]
    over_tcp = Config(pad=[pad])
    over_tcp = msgspec.structs.replace(
        over_tcp, bus=msgspec.structs.replace(over_tcp.bus, endpoint="tcp://127.0.0.1:5570")
    )
    ((keys, text),) = problems_in(over_tcp)
    assert keys == ("pad", 0, "scene", "ambient")
    assert "set bus.keys" in text


def test_numbers_are_finite_wherever_the_joints_go() -> None:
    world, _, baseline, _ = taught(5, 0.005)
    pipeline = pipeline_with(baseline)
    random = np.random.default_rng(3)
    for number, frame in enumerate(world.frames(1.0)):
        joints = dict(zip(("knuckle", "middle", "still"), random.normal(0.0, 10.0, 3).tolist(), strict=True))
        assert pipeline.hand is not None
        pipeline.hand.take(joints, frame.host_time_ns)
        message = pipeline.process(frame)
        assert number < 10 or "posture that was not taught" in message.reason
