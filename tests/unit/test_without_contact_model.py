"""A pad that no contact model fits: it runs all the same, and tells touch, pose and displacement, but no force."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, GeometryConfig, MagnetConfig, PadConfig, SimulatedSource, ToleranceConfig
from fmfts.config.file import load
from fmfts.contact import ModelError, NoContactModel
from fmfts.pipeline._pad import distance
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, no_finger, steady_finger
from fmfts_simulation.source import Simulated

PERIOD_NS = round(1e9 / 220)
SETTLED = 20  # frames
REASON = "no contact model for this pad: "


def config_of(model: str = "default", spacing_mm: float = 9.0) -> PadConfig:
    """A pad with its sensors farther apart than the shipped models' (8 mm), unless told otherwise."""
    half = spacing_mm
    return PadConfig(
        name="odd",
        source=SimulatedSource(turning_deg_per_s=0.0),
        geometry=GeometryConfig(sensors_mm=((half, half, 0), (half, -half, 0), (-half, half, 0), (-half, -half, 0))),
        magnet=MagnetConfig(rest_mm=(0, 0, 12 if spacing_mm == 8.0 else 11)),
        contact=ContactConfig(model=model),
    )


def pipeline(config: PadConfig) -> PadPipeline:
    made = pipeline_of(config, contact_model_of(config), "boot")
    made.use(simulated_baseline(config))
    return made


def messages_of(config: PadConfig, finger: Finger, frames: int = 110) -> list[ContactMessage]:
    source, made = Simulated(config), pipeline(config)
    source.finger = finger
    return [made.process(frame) for step in range(frames) for frame in source.poll(step * PERIOD_NS)]


@pytest.mark.parametrize(("model", "spacing_mm"), [("default", 9.0), ("shear", 9.0), ("none", 9.0), ("none", 8.0)])
def test_pad_without_model_publishes_touch_and_pose_but_no_force(model: str, spacing_mm: float) -> None:
    config = config_of(model, spacing_mm)
    untouched = messages_of(config, no_finger)[SETTLED:]
    pressed = messages_of(config, steady_finger(1e-3, 0.0, 1.0))[SETTLED:]
    assert {message.health for message in untouched + pressed} == {"ok"}
    assert {message.contact for message in untouched} == {False}
    assert {message.contact for message in pressed} == {True}
    for message in untouched + pressed:
        assert message.reason.startswith(REASON)
        assert message.model == "none"
        assert message.pose is not None
        assert not message.over_range
        numbers = msgspec.to_builtins(message)
        assert all(numbers[name] is None for name in numbers if name.startswith(("x_", "y_", "force_", "shear_")))
        assert message.displacement_m is not None
        assert message.displacement_sd_m is not None
        assert 0.0 < message.displacement_sd_m < 1e-4
    rest = np.mean([message.pose.position_m for message in untouched if message.pose], axis=0)
    for message in pressed:
        assert message.pose is not None
        moved = np.linalg.norm(np.array(message.pose.position_m) - rest)
        assert message.displacement_m == pytest.approx(moved, abs=5 * (message.displacement_sd_m or 0.0))
        assert message.displacement_m > 0.1e-3


def test_sensors_elsewhere_keep_model_as_it_goes_from_pose() -> None:
    """Boards of 25 mm cannot lie 16 mm apart. A quarter turn of one of them is no other pad either."""
    places = ((12.7, 12.7, 0), (12.7, -12.7, 0), (-12.7, 12.7, 0), (-12.7, -12.7, 0))
    geometry = GeometryConfig(sensors_mm=places, sensor_rotations_deg=((0, 0, 0), (0, 0, 90), (0, 0, 0), (0, 0, 0)))
    known = ToleranceConfig(modulus=0.0, thickness_mm=0.0)
    contact = ContactConfig(finger_mm=(6.0, 6.0))
    source = SimulatedSource(turning_deg_per_s=0.0)
    config = PadConfig(name="wide", source=source, geometry=geometry, tolerance=known, contact=contact)
    for message in messages_of(config, steady_finger(3e-3, -2e-3, 1.0))[-20:]:
        assert message.health == "ok"
        assert message.force_n == pytest.approx(1.0, abs=5 * message.force_sd_n)
        assert message.force_sd_n < 0.2
        assert message.x_m == pytest.approx(3e-3, abs=5 * message.x_sd_m)
        assert message.y_m == pytest.approx(-2e-3, abs=5 * message.y_sd_m)


def test_reason_says_who_chose_to_run_without_a_model() -> None:
    by_itself, chosen = contact_model_of(config_of("default")), contact_model_of(config_of("none", 8.0))
    assert isinstance(by_itself, NoContactModel)
    assert isinstance(chosen, NoContactModel)
    assert '"default" is for the pad of the shipped config.toml' in by_itself.reason
    assert '[pad.contact] model is "none"' in chosen.reason
    assert "docs/calibration.md" in by_itself.reason


def test_model_file_of_another_pad_is_still_refused() -> None:
    """Who names a file wants that model, and not to run without one."""
    import fmfts.contact.shipped as shipped

    with pytest.raises(ModelError, match="other dimensions"):
        contact_model_of(config_of(str(shipped.DEFAULT_PATH)))


def test_sensor_that_is_left_out_is_named_beside_missing_model() -> None:
    config = config_of()
    source, made = Simulated(config), pipeline(config)
    source.finger = no_finger
    frames = [frame for step in range(60) for frame in source.poll(step * PERIOD_NS)]
    for frame in frames:
        frame.counts[1] = -4096
        message = made.process(frame)
    assert message.health == "degraded"
    assert "sensor" in message.reason.split(REASON)[0]
    assert REASON in message.reason


def test_zero_displacement_has_the_largest_deviation() -> None:
    covariance = np.diag([1e-12, 4e-12, 9e-12, 1e-6, 1e-6])
    assert distance(np.zeros(5), covariance) == (0.0, pytest.approx(3e-6))
    assert distance(np.array([0.0, -2e-4, 0.0, 0.1, 0.1]), covariance) == (pytest.approx(2e-4), pytest.approx(2e-6))


def test_model_none_is_not_a_path(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text('[[pad]]\nname = "a"\nsource = { type = "simulated" }\ncontact = { model = "none" }\n')
    assert load(file)[0].pad[0].contact.model == "none"
