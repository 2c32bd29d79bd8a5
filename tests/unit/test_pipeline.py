from __future__ import annotations

import logging
import tempfile
import time
from collections import Counter
from dataclasses import replace
from typing import Literal

import msgspec
import numpy as np
import pytest

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.origin import Origin
from fmfts.baseline.request import BaselineRequest
from fmfts.bus.encoding import decode_contact
from fmfts.bus.messages import ContactMessage, EventMessage
from fmfts.bus.publisher import Publisher
from fmfts.config import PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.channel import Channel
from fmfts.runtime.sparing_log import SparingLog
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor import Frame
from fmfts.sensor.source import SourceState
from fmfts_client import Endpoints
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger
from fmfts_simulation.source import Simulated

PERIOD_NS = round(1e9 / 220)


NO_LEAD = Lead()


def config_of(seed: int = 1, **scene: object) -> PadConfig:
    turning = 60.0 if scene.get("ambient") == "drifting" else 0.0
    return PadConfig(
        name="left",
        source=SimulatedSource(seed=seed, turning_deg_per_s=turning),
        # Chips placed by a machine.
        tolerance=ToleranceConfig(gain=0.005, sensor_rotation_deg=0.3),
        scene=SceneConfig(**scene),  # type: ignore[arg-type]
    )


def pipeline_of(config: PadConfig, baseline: Baseline | None, lead: Lead = NO_LEAD) -> PadPipeline:
    pad = config.pad()
    model = ContactModel.load("default", pad)
    tracking = tracking_model_for(config.scene, config.magnet).tracking
    pipeline = PadPipeline(pad, model, "boot", 220.0, tracking, lead=lead)
    if baseline is not None:
        pipeline.use(baseline)
    return pipeline


def frames_of(config: PadConfig, finger: Finger | None, seconds: float) -> list[Frame]:
    source = Simulated(config)
    if finger is not None:
        source.finger = finger
    return [frame for step in range(round(seconds * 220)) for frame in source.poll(step * PERIOD_NS)]


@pytest.mark.parametrize("scene", [{"ambient": "constant"}, {"ambient": "drifting"}])
@pytest.mark.parametrize("seed", [1, 2])
def test_scripted_finger_is_detected_within_published_deviations(seed: int, scene: dict[str, str]) -> None:
    """A cycle of taps, presses and slides on a mounted pad; where the field drifts, its robot turns by 60° a second."""
    config = config_of(seed, **scene)
    pipeline, source = pipeline_of(config, simulated_baseline(config)), Simulated(config)
    health: Counter[str] = Counter()
    off: list[list[float]] = []
    idle_contacts = 0
    for step in range(16 * 220):
        for frame in source.poll(step * PERIOD_NS):
            message = pipeline.process(frame)
            x_m, y_m, force_n = source.truth(message.t_sample_ns)
            health[message.health] += 1
            idle_contacts += message.contact is True and step < 4 * 220
            if message.x_m is not None and message.y_m is not None and message.force_n is not None and force_n > 0.1:
                assert message.x_sd_m is not None
                assert message.y_sd_m is not None
                assert message.force_sd_n is not None
                off.append(
                    [
                        (message.x_m - x_m) / message.x_sd_m,
                        (message.y_m - y_m) / message.y_sd_m,
                        (message.force_n - force_n) / message.force_sd_n,
                    ]
                )
    assert health == {"ok": 16 * 220}
    assert idle_contacts == 0
    assert len(off) > 1000
    # "Wrong" is more than five deviations. Errors of one pad are correlated: its rms may be up to twice the stated
    # deviation.
    assert np.abs(off).max() < 5.0
    assert (np.sqrt(np.mean(np.square(off), axis=0)) < 2.0).all()


def test_baseline_recorded_under_load_is_refuted_when_load_goes() -> None:
    """The tolerances of a drawing can swallow half a newton; nothing that a finger does lifts the magnet afterwards."""
    config = config_of(remanence="measured")
    loaded = frames_of(config, steady_finger(0.0, 0.0, 0.5), 1.0)
    baseline, _ = BaselineRequest(config.pad(), config.tolerance.si(), bare=False, replaced=False).make(loaded, None)
    pipeline = pipeline_of(config, baseline)
    for frame in frames_of(config, steady_finger(0.0, 0.0, 0.5), 0.5):
        pipeline.process(frame)
    messages = [pipeline.process(frame) for frame in frames_of(config, no_finger, 1.0)]
    assert "recorded under load" in messages[-1].reason
    assert (messages[-1].health, messages[-1].force_n, messages[-1].contact) == ("no_baseline", None, None)
    # Pressed again, it is as wrong as before, and still reports it.
    again = [pipeline.process(frame) for frame in frames_of(config, steady_finger(0.0, 0.0, 1.0), 0.2)]
    assert again[-1].health == "no_baseline"


def test_damaged_baseline_is_the_reason_that_is_published() -> None:
    config = config_of()
    pipeline = pipeline_of(config, None)
    pipeline.refuse("baseline left.json is damaged")
    message = pipeline.process(frames_of(config, no_finger, 0.02)[0])
    assert (message.health, message.reason) == ("no_baseline", "baseline left.json is damaged")


def test_disturbed_frame_has_no_pose() -> None:
    config = config_of(ambient="constant")
    pipeline = pipeline_of(config, simulated_baseline(config))
    for frame in frames_of(config, no_finger, 0.2):
        message = pipeline.process(replace(frame, counts=frame.counts + np.array([100, -80, 60], dtype=np.int16)))
    assert message.health == "disturbed"
    assert (message.pose, message.force_n, message.contact) == (None, None, None)


def test_silence_keeps_the_time_of_the_last_sample() -> None:
    config = config_of()
    pipeline = pipeline_of(config, simulated_baseline(config))
    assert pipeline.absent("disconnected", "not there").t_sample_ns == 0
    last = [pipeline.process(frame) for frame in frames_of(config, no_finger, 0.1)][-1]
    silent = pipeline.absent("stale", "silent for 1 s")
    assert silent.t_sample_ns == last.t_sample_ns
    assert silent.t_publish_ns > last.t_publish_ns


@pytest.mark.parametrize("told", [True, False])
def test_touch_before_a_silence_ends_with_it(told: bool) -> None:
    """told: of a silence that the loop noticed; else frames are missing that it dropped or that never came."""
    config = config_of()
    pipeline = pipeline_of(config, simulated_baseline(config))
    press = Touch(0.0, 0.0, 1.0)
    frames = frames_of(config, lambda time_s: press if time_s < 0.2 else no_finger(time_s), 0.8)
    assert [pipeline.process(frame).contact for frame in frames[:40]][-1] is True
    if told:
        pipeline.absent("stale", "silent for 0.5 s")
    assert not any(pipeline.process(frame).contact for frame in frames[140:])


class Bench:
    """A channel on a real publisher; what it sends is kept beside."""

    def __init__(
        self, config: PadConfig, rate_hz: float = 220.0, lead: Lead = NO_LEAD, has_baseline: bool = True
    ) -> None:
        self.sent: list[ContactMessage] = []
        self.events: list[EventMessage] = []
        self.source = Simulated(config)
        self.source.finger = no_finger
        self.pipeline = pipeline_of(config, simulated_baseline(config) if has_baseline else None, lead)
        self._publisher = Publisher(Endpoints.from_base(f"ipc://{tempfile.mkdtemp(prefix='fmfts-')}"), "boot")
        send = self._publisher.send_contact

        def keep(pad: str, message: ContactMessage) -> ContactMessage:
            self.sent.append(send(pad, message))
            return self.sent[-1]

        def keep_encoded(topic: bytes, payload: bytes) -> None:
            self.sent.append(decode_contact(payload))

        self._publisher.send_contact = keep  # type: ignore[method-assign]
        self._publisher.send_encoded = keep_encoded  # type: ignore[method-assign]
        self._publisher.send_event = lambda pad, event: self.events.append(event)  # type: ignore[method-assign]
        self.channel = Channel(self.source, 0, self.pipeline, self._publisher, "boot", rate_hz)

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self._publisher.close()


def test_impossible_frame_is_an_event_and_changes_no_health() -> None:
    with Bench(config_of()) as bench:
        for frame in frames_of(config_of(), no_finger, 0.05):
            bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns()))
        health = [event.detail for event in bench.events if event.kind == "health"]
        for _ in range(2):
            bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns() + 60_000_000_000))
    (rejected,) = (event.detail for event in bench.events if event.kind == "rejected")
    assert rejected.startswith("a frame is rejected: ")
    assert [event.detail for event in bench.events if event.kind == "health"] == health


def test_error_in_one_pad_is_lost_and_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    def broken(frame: Frame) -> ContactMessage:
        raise ZeroDivisionError("a bug")

    with Bench(config_of()) as bench, caplog.at_level(logging.ERROR):
        bench.pipeline.answer = broken  # type: ignore[method-assign]
        for frame in frames_of(config_of(), no_finger, 0.05):
            bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns()))
    assert {message.health for message in bench.sent} == {"lost"}
    assert "ZeroDivisionError: a bug" in bench.sent[-1].reason
    assert sum("internal error" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize(
    ("has_clock", "why"),
    [(False, "this computer is overloaded"), (True, "this computer is overloaded, or the clock of the board stands")],
)
def test_frames_that_are_all_overdue_are_not_silence(has_clock: bool, why: str) -> None:
    with Bench(config_of()) as bench:
        bench.source.state.connected, bench.source.state.has_clock = True, has_clock
        for frame in frames_of(config_of(), no_finger, 0.1):
            bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns() - 2_000_000_000))
        bench.channel.tick(time.monotonic_ns())
    assert bench.sent[-1].health == "stale"
    assert bench.sent[-1].reason.endswith(f" late: {why}")
    assert bench.sent[-1].force_n is None


def test_slow_pad_is_not_called_silent_between_its_frames() -> None:
    with Bench(config_of(), rate_hz=5.0) as bench:
        bench.source.state.connected = True
        frame = frames_of(config_of(), no_finger, 0.02)[0]
        bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns()))
        sent = len(bench.sent)
        bench.channel.tick(time.monotonic_ns() + 400_000_000)
        assert len(bench.sent) == sent
        bench.channel.tick(time.monotonic_ns() + 700_000_000)
    assert bench.sent[-1].health == "stale"


@pytest.mark.parametrize("ambient", ["constant", "drifting"])
def test_undetected_corner_press_is_within_force_deviation(ambient: str) -> None:
    """0.3 N at (14, 14) mm move the magnet by 8 µm: no touch is felt, and none must be ruled out to 0.02 N."""
    config = config_of(seed=3, ambient=ambient)
    pipeline = pipeline_of(config, simulated_baseline(config))
    for frame in frames_of(config, steady_finger(14e-3, 14e-3, 0.3), 0.7):
        message = pipeline.process(frame)
        if message.contact is False:
            assert message.force_n is not None
            assert message.force_sd_n is not None
            assert abs(message.force_n - 0.3) < 5.0 * message.force_sd_n


def test_weakest_detected_touch_is_at_the_least_sensitive_place() -> None:
    """Half of it at a corner is no touch of the χ² test, twice of it is one."""
    config = config_of(ambient="constant")
    pad = config.pad()
    model = ContactModel.load("default", pad)
    covariance = np.diag([1e-5, 1e-5, 6e-6, 2e-3, 2e-3, 0.0]) ** 2  # deviation of a pose at rest (physics of the pad)
    detection_limit_n, response = model.detection_limit_n(covariance, 40.0), model.response
    assert response is not None
    scale = np.sqrt(np.diagonal(covariance)[:5]) * [1e3, 1e3, 1e3, 1.0, 1.0]
    for share, felt in ((0.5, False), (2.0, True)):
        press = np.zeros((1, 2 + response.loads))
        press[0, :3] = 14.0, 14.0, share * detection_limit_n
        assert (np.sum((response.change(press)[0] / scale) ** 2) > 40.0) is np.bool_(felt)


@pytest.mark.parametrize("ambient", ["constant", "drifting"])
@pytest.mark.parametrize("gap_s", [0.5, 5.0])
def test_first_frame_after_gap_in_which_pad_was_pressed_is_good(
    ambient: Literal["constant", "drifting"], gap_s: float
) -> None:
    config = PadConfig(
        name="left",
        source=SimulatedSource(finger="none", turning_deg_per_s=0.0),
        scene=SceneConfig(ambient=ambient),
    )
    source, begins_s = Simulated(config), 0.5
    source.finger = lambda time_s: Touch(0.0, 0.0, 3.0 if time_s > begins_s + gap_s / 2 else 0.0)
    pipeline = pipeline_of(config, simulated_baseline(config))
    after = []
    for step in range(round(220 * (begins_s + gap_s + 0.1))):
        for frame in source.poll(round(step * 1e9 / 220)):
            if not begins_s < frame.device_time_us * 1e-6 < begins_s + gap_s:
                message = pipeline.process(frame)
                after += [message] if frame.device_time_us * 1e-6 >= begins_s + gap_s else []
    assert [(one.health, one.reason) for one in after[:5]] == [("ok", "")] * 5
    assert after[4].contact


def test_refused_baseline_stays_unused_once_the_board_is_known() -> None:
    """A baseline that no pad of this drawing can have: its board appears, and the daemon goes on without one."""
    good = simulated_baseline(config_of())
    assert good.rest is not None
    uid = "31" * 12
    one, two, three, four = good.rest.mean_t
    swapped = msgspec.structs.replace(good.rest, mean_t=(one, three, two, four))
    origin = Origin(kind="bridge", chip="hmc5983", uid=uid)
    bench = Bench(config_of(), has_baseline=False)
    with bench:
        bench.channel.baseline.origin = Origin(kind="bridge", chip="hmc5983")
        with pytest.raises(BaselineError):
            bench.channel.use(msgspec.structs.replace(good, rest=swapped, origin=origin))
        bench.pipeline.refuse("it does not fit")
        bench.source.state.board["uid"] = uid
        for frame in frames_of(config_of(), no_finger, 0.05):
            bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns()))
    assert {(message.health, message.reason) for message in bench.sent} == {("no_baseline", "it does not fit")}


def test_source_being_opened_raises_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    with Bench(config_of()) as bench, caplog.at_level(logging.INFO):
        bench.source.state.since_ns = 0
        bench.source.state.connected = False
        bench.source.state.reason = SourceState("").reason
        bench.channel.tick(time.monotonic_ns())
        bench.source.state.connect(time.monotonic_ns())
        bench.channel.tick(time.monotonic_ns())
        bench.source.state.disconnect("gone", time.monotonic_ns())
        bench.channel.tick(time.monotonic_ns())
    told = [
        (record.levelname, record.message) for record in caplog.records if record.name == "fmfts.runtime.sparing_log"
    ]
    assert [level for level, _ in told] == ["INFO", "WARNING", "WARNING"]
    assert "it is being opened" in told[0][1]
    assert [message.health for message in bench.sent] == ["disconnected", "stale", "disconnected"]


def test_why_a_source_cannot_be_opened_is_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    with Bench(config_of()) as bench, caplog.at_level(logging.INFO):
        state = bench.source.state
        state.connected, state.since_ns, state.reason = False, 0, SourceState("").reason
        for reason in ("", "/dev/i2c-1 does not exist: enable I2C", "/dev/i2c-1 is locked"):
            if reason:
                state.disconnect(reason, time.monotonic_ns())
            for _ in range(2):
                bench.channel.tick(time.monotonic_ns())
    told = [(record.levelname, record.message) for record in caplog.records if "disconnected" in record.message]
    assert [level for level, _ in told] == ["INFO", "WARNING"]
    assert "it is being opened" in told[0][1]
    assert "/dev/i2c-1 does not exist: enable I2C" in told[1][1]


def test_overload_log_is_bounded_and_names_count_and_end(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with Bench(config_of()) as bench, caplog.at_level(logging.INFO):
        lateness = bench.channel._lateness
        log = SparingLog("left", lateness)
        for tenth in range(300):
            now_ns = tenth * 100_000_000
            lateness.is_to_be_left_out(now_ns - 1_000_000_000, now_ns)
            log.tell(logging.WARNING, "late" if tenth % 2 else "ok", now_ns)
            log.catch_up(now_ns)
        log.catch_up(31_000_000_000)
        log.tell(logging.WARNING, "disconnected", 31_100_000_000, is_urgent=True)
    told = [record.message for record in caplog.records if record.name == "fmfts.runtime.sparing_log"]
    assert len(told) == 11
    assert told[:3] == ["pad 'left': ok", "pad 'left': late", "pad 'left': ok"], "a short stall is told whole"
    assert told[3] == (
        "pad 'left': ok (97 changes are not in the log, because the computer was overloaded: among them late)"
    )
    assert told[9].startswith("pad 'left': late"), "the last state is never kept back for good"
    assert told[10] == "pad 'left': disconnected"


def test_log_says_that_one_change_is_missing(caplog: pytest.LogCaptureFixture) -> None:
    with Bench(config_of()) as bench, caplog.at_level(logging.INFO):
        lateness = bench.channel._lateness
        log = SparingLog("left", lateness)
        lateness.is_to_be_left_out(0, 1_000_000_000)
        for second in (1, 2, 3, 4):
            log.tell(logging.WARNING, "late", second * 1_000_000_000)
        log.tell(logging.INFO, "ok", 15_000_000_000)
    assert [(record.levelname, record.message) for record in caplog.records[-2:]] == [
        (
            "WARNING",
            "pad 'left': 1 change is not in the log, because the computer was overloaded: among them late",
        ),
        ("INFO", "pad 'left': ok"),
    ]


def test_each_omitted_health_is_quoted_with_its_reason(caplog: pytest.LogCaptureFixture) -> None:
    with Bench(config_of()) as bench, caplog.at_level(logging.INFO):
        bench.channel._lateness.is_to_be_left_out(0, 1_000_000_000)
        log = SparingLog("left", bench.channel._lateness)
        changes = ["stale", "ok", "stale", "lost: no pose fits", "stale", "ok"]
        for second, text in enumerate(changes):
            log.tell(logging.INFO if text == "ok" else logging.WARNING, text, second * 1_000_000_000)
        log.catch_up(9_000_000_000)
        assert len(caplog.records) == 3
        log.catch_up(11_000_000_000)
    assert [record.message for record in caplog.records[-2:]] == [
        "pad 'left': 2 changes are not in the log, because the computer was overloaded: among them lost: no pose fits; "
        "stale",
        "pad 'left': ok",
    ]


def test_reports_of_an_overload_keep_no_health_out_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    with Bench(config_of()) as bench, caplog.at_level(logging.INFO):
        channel, begun_ns = bench.channel, time.monotonic_ns()
        for second in range(8):
            if second % 2 == 0:
                channel.source.state.left_out[0] = channel.source.state.left_out.get(0, 0) + 9
            channel.status(begun_ns + second * 1_000_000_000)
        channel.announcer.send(bench.pipeline.absent("lost", "no pose fits"))
    told = [record.message for record in caplog.records if record.name == "fmfts.runtime.sparing_log"]
    assert told[-1] == "pad 'left': lost: no pose fits"
    assert told[0] == (
        "pad 'left': this computer is overloaded: 100 % of the frames left out; health is disconnected; see "
        "docs/latency.md"
    )
    events = [event.detail for event in bench.events if event.kind == "overload"]
    assert f"pad 'left': {events[0]}" == told[0]
    assert events[1] == "this computer keeps up again: no frames are left out; health is disconnected"
