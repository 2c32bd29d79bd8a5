"""A skin whose magnets nobody knows, from its frames to its messages, by a table from contact to field."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.baseline import BaselineError
from fmfts.baseline.request import BaselineRequest, Recorded
from fmfts.bus.messages import ContactMessage
from fmfts.config import Config, ContactConfig, GeometryConfig, PadConfig, SceneConfig, SiliconeConfig, SimulatedSource
from fmfts.config.checks import problems_in
from fmfts.contact import ModelError
from fmfts.pad import Array
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.snapshot import BadMemoryError, restore, snapshot
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS
from fmfts_skin.calibrate.field_fit import make_response
from fmfts_skin.field_response import FieldResponse
from fmfts_skin.pipeline import BARE_ONLY, SkinPipeline
from fmfts_skin.settings import AnyskinSource
from skin.skin_pad import SENSORS_MM, presses, skin_set, streamed_field

RATE_HZ = 100
PERIOD_US = 1_000_000 // RATE_HZ
CHIP = CHIPS["mlx90393_streamed"]
NOISE_UT, TABLE_NOISE_UT = 0.6, 1.5
MM_OF_A_NEWTON = 0.3
NOBODY = (0.0, 0.0, 0.0)


@cache
def response(load: str) -> FieldResponse:
    """The response by noisy presses: over depth in mm, or over force in N."""
    press = presses(1500, 1)
    field = streamed_field(press) + np.random.default_rng(2).normal(0.0, TABLE_NOISE_UT, (len(press), 15))
    press[:, 2] /= MM_OF_A_NEWTON if load == "force_n" else 1.0
    return make_response(skin_set(press, field, ("x_mm", "y_mm", load)), "skin", lambda line: None)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "skin.response"
    path.write_bytes(response("force_n").encoded())
    return path


def config(model: Path | str, **other: object) -> PadConfig:
    places = tuple((float(x), float(y), 0.0) for x, y, _ in SENSORS_MM)
    return PadConfig(
        name="skin",
        source=AnyskinSource(port="/dev/null", rate_hz=RATE_HZ),
        geometry=GeometryConfig(sensors_mm=places),
        contact=ContactConfig(model=str(model)),
        scene=SceneConfig(ambient="drifting"),
        **other,  # type: ignore[arg-type]
    )


def frames(
    count: int, press: tuple[float, float, float], first: int = 0, ambient_ut: Array | None = None
) -> Iterator[Frame]:
    """press: x, y in mm, and the force in N."""
    random = np.random.default_rng(first + 7)
    still = streamed_field(np.array([[press[0], press[1], press[2] * MM_OF_A_NEWTON]])).reshape(5, 3)
    ambient = np.zeros(3) if ambient_ut is None else ambient_ut
    for number in range(first, first + count):
        field_t = (still + ambient + random.normal(0.0, NOISE_UT, (5, 3))) * 1e-6
        counts = np.rint(field_t / np.asarray(CHIP.step_t[0])).astype(np.int16)
        yield Frame(
            *(0, number, number * PERIOD_US, number * PERIOD_US * 1000, 0, counts),
            *(np.zeros(5, dtype=np.uint16), np.ones(5, dtype=np.bool_), np.ones(5, dtype=np.bool_), 25.0),
            chip=CHIP,
        )


def without(frame: Frame, *sensors: int) -> Frame:
    valid = frame.valid.copy()
    valid[list(sensors)] = False
    return replace(frame, valid=valid)


def ready(model: Path) -> SkinPipeline:
    made = config(model)
    pipeline = pipeline_of(made, contact_model_of(made), "boot")
    assert isinstance(pipeline, SkinPipeline)
    request = BaselineRequest(made.pad(), made.tolerance.si(), bare=False, replaced=False, duration_s=1.0)
    pipeline.use(request.make(list(frames(100, NOBODY)), None)[0])
    return pipeline


def told(pipeline: SkinPipeline, some: Iterator[Frame]) -> list[ContactMessage]:
    return [pipeline.process(frame) for frame in some]


def off(message: ContactMessage, press: tuple[float, float, float]) -> list[float]:
    """Errors in deviations."""
    assert message.x_m is not None
    assert message.y_m is not None
    assert message.force_n is not None
    return [
        abs(message.x_m * 1e3 - press[0]) / (message.x_sd_m or 0.0) / 1e3,
        abs(message.y_m * 1e3 - press[1]) / (message.y_sd_m or 0.0) / 1e3,
        abs(message.force_n - press[2]) / (message.force_sd_n or 0.0),
    ]


@pytest.mark.parametrize("press", [(0.0, 0.0, 3.0), (5.0, -4.0, 6.0), (-7.0, 3.0, 2.0), (8.0, 8.0, 8.0)])
def test_press_is_reported_with_place_and_force_within_deviations(
    press: tuple[float, float, float], model: Path
) -> None:
    pipeline = ready(model)
    quiet = told(pipeline, frames(30, NOBODY, 100))
    assert {(message.health, message.contact, message.force_n) for message in quiet} == {("ok", False, None)}
    messages = told(pipeline, frames(30, press, 130))[3:]
    assert {(message.health, message.contact, message.over_range) for message in messages} == {("ok", True, False)}
    errors = np.array([off(message, press) for message in messages])
    assert errors.max() < 5.0
    assert max(message.x_sd_m or 1.0 for message in messages) < 1.5e-3
    assert told(pipeline, frames(5, NOBODY, 160))[-1].contact is False


def test_turning_in_earths_field_makes_and_moves_no_contact(model: Path) -> None:
    """Without the ambient field among the errors, 60 µT are a press of half a newton."""
    pipeline, press = ready(model), (3.0, 2.0, 5.0)
    for first, ambient_ut in enumerate(np.array([[60.0, 0.0, 0.0], [0.0, -60.0, 30.0], [-40.0, 30.0, -60.0]])):
        begun = 100 + 60 * first
        quiet = told(pipeline, frames(20, NOBODY, begun, ambient_ut))
        assert {message.contact for message in quiet} == {False}
        pressed = told(pipeline, frames(20, press, begun + 30, ambient_ut))[3:]
        assert {message.health for message in pressed} == {"ok"}
        assert max(max(off(message, press)) for message in pressed) < 5.0


def test_silent_sensor_is_named_and_others_give_the_press(model: Path) -> None:
    pipeline, press = ready(model), (3.0, 2.0, 5.0)
    messages = told(pipeline, (without(frame, 2) for frame in frames(30, press, 100)))[3:]
    assert {message.health for message in messages} == {"degraded"}
    assert "sensor 3 is silent" in messages[-1].reason
    assert max(max(off(message, press)) for message in messages) < 5.0
    two = told(pipeline, (without(frame, 2, 4) for frame in frames(5, press, 140)))[-1]
    assert two.contact is True
    three = told(pipeline, (without(frame, 0, 2, 4) for frame in frames(5, press, 150)))[-1]
    assert (three.health, three.contact, three.force_n) == ("lost", None, None)
    assert "only 6 values are left" in three.reason


def test_field_that_no_contact_causes_is_disturbed(model: Path) -> None:
    """A magnet beside one sensor."""
    pipeline = ready(model)
    for frame in frames(10, NOBODY, 100):
        counts = frame.counts.copy()
        counts[1] += np.int16(800)
        message = pipeline.process(replace(frame, counts=counts))
    assert (message.health, message.contact, message.x_m, message.force_n) == ("disturbed", None, None, None)
    assert "steel or a magnet nearby" in message.reason


def test_press_beyond_the_table_has_a_lower_bound_only(model: Path) -> None:
    hardest = response("force_n").axes[-1].last
    message = told(ready(model), frames(10, (0.0, 0.0, 1.3 * hardest), 100))[-1]
    assert (message.contact, message.over_range, message.x_m, message.force_n) == (True, True, None, None)
    assert message.force_min_n == pytest.approx(hardest)


def test_table_of_depths_gives_place_without_force(tmp_path: Path) -> None:
    path = tmp_path / "depth.response"
    path.write_bytes(response("depth_mm").encoded())
    message = told(ready(path), frames(10, (4.0, -3.0, 5.0), 100))[-1]
    assert message.contact is True
    assert message.force_n is None
    assert message.x_m == pytest.approx(4e-3, abs=5 * (message.x_sd_m or 0.0))


def test_skin_without_rest_recording_publishes_no_estimate(model: Path) -> None:
    made = config(model)
    pipeline = pipeline_of(made, contact_model_of(made), "boot")
    bare = BaselineRequest(made.pad(), made.tolerance.si(), bare=True, replaced=False, duration_s=1.0)
    away = np.array([-streamed_field(np.array([NOBODY]))]).reshape(5, 3)  # no skin: the Earth's field alone
    some = [replace(frame, counts=np.zeros((5, 3), np.int16) + np.int16(20)) for frame in frames(100, NOBODY)]
    assert away.any()
    pipeline.use(bare.make(some, None)[0])
    message = pipeline.process(next(frames(1, NOBODY, 200)))
    assert (message.health, message.reason, message.contact) == ("no_baseline", BARE_ONLY, None)


def test_keys_that_change_nothing_are_refused(model: Path) -> None:
    contact = ContactConfig(model=str(model), refine=True, smoothing_ms=40.0)
    made = msgspec.structs.replace(config(model, silicone=SiliconeConfig(hysteresis=0.1)), contact=contact)
    keys = {keys for keys, _ in problems_in(Config(pad=(made,)))}
    section = ("pad", 0)
    expected = ("contact", "refine"), ("contact", "smoothing_ms"), ("silicone", "hysteresis")
    assert keys == {(*section, *one) for one in expected}


@pytest.mark.parametrize("option", ["turn", "refine"])
def test_turning_and_presses_are_refused_with_the_reason(option: str, model: Path) -> None:
    made = config(model)
    rest = BaselineRequest(made.pad(), made.tolerance.si(), bare=False, replaced=False, duration_s=1.0)
    before = rest.make(list(frames(100, NOBODY)), None)[0]
    request = BaselineRequest(
        made.pad(), made.tolerance.si(), bare=False, replaced=False, duration_s=1.0, **{option: True}
    )
    with pytest.raises(BaselineError, match="this pad's magnets are unknown"):
        request.make(list(frames(100, NOBODY, 100)), before)


def test_report_of_a_rest_says_what_was_recorded(model: Path, tmp_path: Path) -> None:
    made = config(model)
    request = BaselineRequest(made.pad(), made.tolerance.si(), bare=False, replaced=False, duration_s=1.0)
    baseline, mounting = request.make(list(frames(100, NOBODY)), None)
    facts = Recorded(baseline, mounting, tmp_path, {}).facts(made.pad())
    assert facts["kind"] == "rest"
    assert facts["noise_t"] == pytest.approx(NOISE_UT * 1e-6, rel=0.2)
    assert "remanence_t" not in facts


def test_another_pipeline_goes_on_from_its_memory_to_last_bit(model: Path) -> None:
    one, other = ready(model), ready(model)
    told(one, frames(20, (3.0, 2.0, 5.0), 100))
    restore(other, snapshot(one))
    left, right = (told(pipeline, frames(20, (3.2, 2.0, 5.0), 120)) for pipeline in (one, other))
    for first, second in zip(left, right, strict=True):
        assert (first.seq, first.x_m, first.y_m, first.force_n, first.force_sd_n) == (
            *(second.seq, second.x_m, second.y_m, second.force_n, second.force_sd_n),
        )
    with pytest.raises(BadMemoryError):
        restore(other, b"\x80")


def test_table_of_another_skin_is_refused(model: Path, tmp_path: Path) -> None:
    four = GeometryConfig(sensors_mm=config(model).geometry.sensors_mm[:4])
    with pytest.raises(ModelError, match=r"is of 5 sensors, the pad has 4: see sensors_mm"):
        contact_model_of(
            PadConfig(
                name="skin",
                source=AnyskinSource(port="/dev/null"),
                geometry=four,
                contact=ContactConfig(model=str(model)),
            )
        )
    (tmp_path / "no.response").write_bytes(b"no table")
    with pytest.raises(ModelError, match=r"is no field response.*`fmfts-daemon calibrate` makes one"):
        contact_model_of(config(tmp_path / "no.response"))


def test_skin_is_nobodys_neighbour(model: Path) -> None:
    beside = PadConfig(name="beside", source=SimulatedSource(), scene=SceneConfig(neighbours=("skin",)))
    told = " ".join(text for _, text in problems_in(Config(pad=(config(model), beside))))
    assert "the magnets of 'skin' are unknown, and so is their field here" in told


def test_configuration_refuses_what_a_skin_cannot_do(model: Path) -> None:
    assert not problems_in(Config(pad=(config(model),)))
    simulated = PadConfig(name="skin", source=SimulatedSource(), contact=ContactConfig(model=str(model)))
    told = " ".join(text for _, text in problems_in(Config(pad=(simulated,))))
    assert "what is simulated has magnets that are known" in told
