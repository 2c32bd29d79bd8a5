"""The demo's simulated pads are set up as a user sets up a real one: self-test, bare, rest and turn."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.baseline import Baseline
from fmfts.baseline.files import path_of
from fmfts.config import ContactConfig, PadConfig, SimulatedSource, ToleranceConfig
from fmfts.config.example import ARRAY_PATH, EXAMPLE_PATH
from fmfts.config.file import load
from fmfts.pad import rotation_from_vector
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts_lab.bench.tapped import without_baseline
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.demo import set_up_pads
from fmfts_simulation.finger import no_finger, steady_finger
from fmfts_simulation.set_up import set_up
from fmfts_simulation.source import TUMBLE_S, tumbled

PERIOD_NS = 4_545_455
LIMIT_N, LARGEST_FORCE_SD_N = 1.0, 0.5  # of clients/c/examples/gripper.c


@pytest.fixture(scope="module")
def demo() -> tuple[PadConfig, Baseline, list[str]]:
    (config,) = load(EXAMPLE_PATH)[0].pad
    return config, *set_up(config)


def test_set_up_goes_through_all_steps_of_a_user(demo: tuple[PadConfig, Baseline, list[str]]) -> None:
    _, baseline, steps = demo
    assert steps == ["self-test", "bare", "rest", "turn"]
    assert baseline.gains is not None
    assert baseline.gains_from == "turn"
    assert None not in (baseline.bare, baseline.rest, baseline.turn)


def test_chip_without_a_self_test_is_set_up_without_one() -> None:
    _, steps = set_up(PadConfig(name="a", source=SimulatedSource(chip="qmc5883p", rate_hz=200, range_gauss=8.0)))
    assert steps == ["bare", "rest", "turn"]


def pressed(config: PadConfig, baseline: Baseline, place_m: tuple[float, float]) -> list[tuple[float, float]]:
    """Forces and deviations (N) of a fresh pad, pressed with 1 N from the first second on, over the second second."""
    pipeline: PadPipeline = without_baseline(config, load_contact_model(config))
    pipeline.use(baseline)
    source, finger = simulated_pad(config), steady_finger(*place_m, 1.0)
    source.finger = lambda time_s: finger(time_s) if time_s > 1.0 else no_finger(time_s)
    messages = [pipeline.process(frame) for step in range(440) for frame in source.poll(step * PERIOD_NS)]
    told = messages[-200:]
    assert {message.health for message in told} == {"ok"}
    return [(message.force_n or 0.0, message.force_sd_n or 0.0) for message in told]


@pytest.mark.parametrize("place_m", [(0.0, 0.0), (4e-3, 3e-3), (-6e-3, 2e-3)])
def test_newton_is_known_to_a_tenth_except_for_silicone(
    demo: tuple[PadConfig, Baseline, list[str]], place_m: tuple[float, float]
) -> None:
    """20 % of the modulus (upwards, of its logarithm), the thickness, and the finger's size are counted beside what the
    set-up leaves."""
    config, baseline, _ = demo
    config = msgspec.structs.replace(config, contact=ContactConfig(finger_mm=(6.0, 6.0)))
    known = msgspec.structs.replace(config, tolerance=ToleranceConfig(modulus=0.0, thickness_mm=0.0))
    told = np.array(pressed(known, baseline, place_m))
    assert told[:, 1].max() <= 0.1
    assert np.abs(told[:, 0] - 1.0).max() < 0.1
    by_silicone = msgspec.structs.replace(config, tolerance=ToleranceConfig(modulus=0.2, thickness_mm=0.0))
    counted = np.sqrt(np.array(pressed(by_silicone, baseline, place_m))[:, 1] ** 2 - told[:, 1] ** 2)
    assert counted == pytest.approx(np.expm1(0.2) * told[:, 0], rel=0.1)


def test_touches_of_the_demo_are_certain_enough_for_the_gripper(demo: tuple[PadConfig, Baseline, list[str]]) -> None:
    """It opens above 1 N anyway. Below, a force that it calls less certain would keep it open for no reason."""
    config, baseline, _ = demo
    source = simulated_pad(config)
    pipeline: PadPipeline = without_baseline(config, load_contact_model(config))
    pipeline.use(baseline)
    told = [pipeline.process(frame) for step in range(20 * 220) for frame in source.poll(step * PERIOD_NS)]
    light = [one.force_sd_n for one in told if one.force_n is not None and one.force_sd_n and one.force_n <= LIMIT_N]
    assert sum(one.contact is True for one in told) > 1000
    assert len(light) > 3000
    assert max(light) < LARGEST_FORCE_SD_N


def test_demo_stores_what_its_daemon_will_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    environ = {"XDG_STATE_HOME": str(tmp_path)}
    set_up_pads(ARRAY_PATH, environ)
    assert path_of("array", environ=environ) == tmp_path / "fmfts" / "baseline" / "array.json"
    assert path_of("array", environ=environ).exists()
    assert capsys.readouterr().out.startswith("pad array: self-test, bare, rest and turn were simulated in ")


def test_demo_sets_up_simulated_pads_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "pad.toml"
    config.write_text('[[pad]]\nname = "left"\n[pad.source]\ntype = "bridge"\nport = "/dev/null"\n')
    set_up_pads(config, {"XDG_STATE_HOME": str(tmp_path)})
    assert capsys.readouterr().out == ""
    assert not (tmp_path / "fmfts").exists()


def test_tumbling_pad_turns_once_about_each_axis() -> None:
    field_t = np.array([2e-5, -1e-5, 4e-5])
    for moment_s in (0.0, 3.0, 9.0, 17.0, TUMBLE_S + 3.0):
        turn, left = np.eye(3), 3.0 * (moment_s % TUMBLE_S) / TUMBLE_S
        for axis in np.eye(3):
            turn = rotation_from_vector(2.0 * np.pi * min(max(left, 0.0), 1.0) * axis) @ turn
            left -= 1.0
        np.testing.assert_allclose(tumbled(field_t, np.array([moment_s]))[0], turn @ field_t, atol=1e-18)
