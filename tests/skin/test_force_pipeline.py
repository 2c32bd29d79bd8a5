"""A pad whose frames become forces in three directions, by each route of `calibrate`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from test_force_sets import MAGNET, PAD, write_session

from fmfts.baseline.request import BaselineRequest
from fmfts.bus.messages import ContactMessage
from fmfts.config import Config, ContactConfig, GeometryConfig, PadConfig, SceneConfig
from fmfts.config.checks import problems_in
from fmfts.contact import ModelError
from fmfts.pad import Array
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.snapshot import restore, snapshot
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS
from fmfts_lab.calibration.simulated import pressed_fields
from fmfts_skin.calibrate.force_command import make_force_file
from fmfts_skin.force_model import ForceModel
from fmfts_skin.pipeline import SkinPipeline
from fmfts_skin.settings import AnyskinSource

RATE_HZ = 100
PERIOD_US = 1_000_000 // RATE_HZ
CHIP = CHIPS["mlx90393_streamed"]
NOISE_UT = 0.3
Press = tuple[float, float, float, float, float]
NOBODY: Press = (0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module", params=["field", "both"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("forces")
    sessions = [write_session(folder / f"day{seed}.csv", seed) for seed in (1, 2, 3)]
    make_force_file(sessions, folder / "pad.force", MAGNET, request.param, lambda _: None)
    return folder / "pad.force"


def config(model: Path, ambient: str = "constant") -> PadConfig:
    return PadConfig(
        name="skin",
        source=AnyskinSource(port="/dev/null", rate_hz=RATE_HZ),
        contact=ContactConfig(model=str(model)),
        scene=SceneConfig(ambient=ambient),  # type: ignore[arg-type]
    )


def frames(count: int, press: Press, first: int, ambient_ut: Array | None = None, bad: int = -1) -> Iterator[Frame]:
    """press: x, y in mm, force and shear in N. bad: a sensor that delivers nothing."""
    random = np.random.default_rng(first + 7)
    still = pressed_fields(PAD, np.array([press]))[0] + (0.0 if ambient_ut is None else ambient_ut * 1e-6)
    for number in range(first, first + count):
        field_t = still + random.normal(0.0, NOISE_UT * 1e-6, (4, 3))
        counts = np.rint(field_t / np.asarray(CHIP.step_t[0])).astype(np.int16)
        yield Frame(
            *(0, number, number * PERIOD_US, number * PERIOD_US * 1000, 0, counts),
            *(np.zeros(4, dtype=np.uint16), np.ones(4, dtype=np.bool_), np.arange(4) != bad, 25.0),
            chip=CHIP,
        )


def ready(model: Path, ambient: str = "constant", ambient_ut: Array | None = None) -> SkinPipeline:
    """ambient_ut: the ambient field at the baseline."""
    made = config(model, ambient)
    assert not problems_in(Config(pad=(made,)))
    pipeline = pipeline_of(made, contact_model_of(made), "boot")
    assert isinstance(pipeline, SkinPipeline)
    request = BaselineRequest(made.pad(), made.tolerance.si(), bare=False, replaced=False, duration_s=1.0)
    pipeline.use(request.make(list(frames(100, NOBODY, 0, ambient_ut)), None)[0])
    return pipeline


def told(pipeline: SkinPipeline, some: Iterator[Frame]) -> list[ContactMessage]:
    return [pipeline.process(frame) for frame in some]


def off(message: ContactMessage, press: Press) -> list[float]:
    """Errors of force and shear in deviations."""
    found = (message.force_n, message.shear_x_n, message.shear_y_n)
    spread = (message.force_sd_n, message.shear_x_sd_n, message.shear_y_sd_n)
    return [abs(one - truth) / sd for one, sd, truth in zip(found, spread, press[2:], strict=True)]  # type: ignore[operator]


@pytest.mark.parametrize("press", [(0.0, 0.0, 1.5, 0.2, -0.2), (1.5, -1.0, 1.0, -0.2, 0.0), (-1.0, 1.5, 1.9, 0.0, 0.4)])
def test_press_has_force_and_shear_within_the_deviations(press: Press, model: Path) -> None:
    pipeline = ready(model)
    quiet = told(pipeline, frames(200, NOBODY, 100))
    assert {(message.health, message.contact, message.force_n) for message in quiet} == {("ok", False, None)}
    messages = told(pipeline, frames(60, press, 300))[3:]
    assert {(message.health, message.contact, message.over_range) for message in messages} == {("ok", True, False)}
    assert {message.x_m for message in messages} == {None}
    assert np.array([off(message, press) for message in messages]).max() < 5.0
    assert max(message.force_sd_n or 9.0 for message in messages) < 0.3
    assert told(pipeline, frames(5, NOBODY, 360))[-1].contact is False


def test_ambient_field_of_the_baseline_is_no_pose(model: Path) -> None:
    """The pose is solved without it. Only the rest's size, by which changes are divided, holds it (5 % of force)."""
    press, ambient_ut = (0.5, 0.5, 1.5, 0.1, 0.1), np.array([30.0, -20.0, 20.0])
    messages = told(ready(model, ambient_ut=ambient_ut), frames(40, press, 100, ambient_ut))[3:]
    plain = told(ready(model), frames(40, press, 100))[3:]
    assert np.array([off(message, press) for message in messages]).max() < 5.0
    change_n = np.array([(a.force_n or 0.0) - (b.force_n or 0.0) for a, b in zip(messages, plain, strict=True)])
    assert np.abs(change_n).max() < 0.1


def test_deviation_includes_another_day_in_each_frame(model: Path, tmp_path: Path) -> None:
    """The file's deviation applies to the 200th frame as to the first: no average reduces it."""
    forces = ForceModel.of(model.read_bytes(), "model")
    (tmp_path / "no.force").write_bytes(msgspec.structs.replace(forces, day_share=0.0).encoded())
    press = (0.0, 0.0, 1.8, 0.0, 0.0)
    known, unknown = (told(ready(one), frames(200, press, 100))[3:] for one in (tmp_path / "no.force", model))
    for one, other in ((known[0], unknown[0]), (known[-1], unknown[-1])):
        day_n = np.sqrt((other.force_sd_n or 0.0) ** 2 - (one.force_sd_n or 0.0) ** 2)
        assert day_n == pytest.approx(0.03 * forces.widened[2] * 1.8, rel=0.1)


def test_turning_robot_makes_no_contact(model: Path) -> None:
    pipeline = ready(model, "drifting")
    for first, ambient_ut in enumerate(np.array([[60.0, 0.0, 0.0], [0.0, -60.0, 30.0], [-40.0, 30.0, -60.0]])):
        quiet = told(pipeline, frames(20, NOBODY, 100 + 30 * first, ambient_ut))
        assert {message.contact for message in quiet} == {False}


def test_silent_sensor_is_named_and_others_give_the_force(model: Path) -> None:
    press = (0.5, 0.5, 1.5, 0.1, 0.1)
    messages = told(ready(model), frames(40, press, 100, bad=2))[20:]
    assert {message.health for message in messages} == {"degraded"}
    assert all("sensor 3" in message.reason for message in messages)
    assert np.array([off(message, press) for message in messages]).max() < 5.0


def test_press_beyond_the_presses_is_over_range(model: Path) -> None:
    messages = told(ready(model), frames(20, (0.0, 0.0, 4.0, 0.0, 0.0), 100))[3:]
    assert {(message.contact, message.over_range, message.force_n) for message in messages} == {(True, True, None)}


@pytest.mark.parametrize("press", [NOBODY, (0.5, 0.5, 1.5, 0.1, 0.1)])
def test_uneven_foreign_field_is_disturbed(press: Press, model: Path) -> None:
    """A magnet near one corner of the pad. By both routes an untouched pad rightly says that nothing touches it."""
    uneven_ut = np.array([[30.0, 10.0, -20.0], [3.0, 1.0, -2.0], [3.0, 1.0, -2.0], [1.0, 0.0, -1.0]])
    pipeline = ready(model)
    messages = told(pipeline, frames(30, press, 100, uneven_ut))[3:]
    if press == NOBODY and ForceModel.of(model.read_bytes(), "model").route == "both":
        assert {(message.contact, message.force_n) for message in messages} == {(False, None)}
        return
    assert {(message.health, message.contact, message.force_n) for message in messages} == {("disturbed", None, None)}
    assert "steel or a magnet nearby" in messages[0].reason


def test_another_pipeline_continues_from_its_memory(model: Path) -> None:
    one, other = ready(model), ready(model)
    told(one, frames(20, (0.0, 0.0, 1.0, 0.0, 0.0), 100))
    restore(other, snapshot(one))
    left, right = (told(pipeline, frames(5, (0.2, 0.0, 1.0, 0.0, 0.0), 120)) for pipeline in (one, other))
    assert [(a.seq, a.force_n, a.force_sd_n) for a in left] == [(b.seq, b.force_n, b.force_sd_n) for b in right]


def test_model_of_poses_or_of_other_sensors_is_refused(model: Path, tmp_path: Path) -> None:
    session = write_session(tmp_path / "day.csv", 1)
    make_force_file([session], tmp_path / "pose.force", MAGNET, "pose", lambda _: None)
    with pytest.raises(ModelError, match="from poses alone to forces, which a running pad does not do"):
        contact_model_of(config(tmp_path / "pose.force"))
    three = GeometryConfig(sensors_mm=((6.0, 6.0, 0.0), (-6.0, 6.0, 0.0), (6.0, -6.0, 0.0)))
    fewer = PadConfig(
        name="skin", source=AnyskinSource(port="/dev/null"), geometry=three, contact=ContactConfig(model=str(model))
    )
    with pytest.raises(ModelError, match="more sensors than the pad's 3"):
        contact_model_of(fewer)


def test_overview_reports_the_largest_force(model: Path) -> None:
    largest_n = contact_model_of(config(model)).calibrated_range["calibrated_force_n"]
    assert 1.8 < float(str(largest_n)) < 2.1
