"""What a real pad does besides what its tolerances name: the daemon is right, or says so; never wrong and ok.

`python -m fmfts_lab.bench silicone` prints the same for more pads.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.drills import Ambient
from fmfts_lab.bench.silicone import EFFECTS, Row, trial
from fmfts_simulation.finger import Touch, no_finger, steady_finger
from fmfts_simulation.finger_shape import PATCH_MM2, SHAPES, FingerShape
from fmfts_simulation.imperfect_chips import STEP_T
from fmfts_simulation.mounted import MountedPad
from fmfts_simulation.solved_table import standard_mechanics
from fmfts_simulation.source import Simulated

SECONDS = 6.0
# Effects that baselines accept, and after which most frames are published.
MILD = [one.name for one in EFFECTS if one.name not in ("casting, unnamed", "disturbed chip", "thimble")]


@cache
def row(name: str, ambient: Ambient, seed: int = 2) -> Row:
    (effect,) = [one for one in EFFECTS if one.name == name]
    seconds = 12.0 if name == "disturbed chip" else SECONDS
    result = Row(name, ambient, seed)
    trial(effect, ambient, seed, seconds, False, result, load_contact_model(effect.config(ambient, seed)))
    return result


@pytest.mark.parametrize("name", MILD)
def test_mild_effect_makes_no_frame_wrong_and_no_false_contact(name: str) -> None:
    """In the scene that it disturbs more: where nothing else is unknown."""
    found = row(name, "constant")
    assert found.frames >= SECONDS * 219, found.refused
    assert found.wrong == 0, found.line
    assert found.longest_false_s < 1.0, found.line
    assert found.health["ok"] > 0.99 * found.frames, found.line


def test_magnet_cast_askew_is_refused_with_tolerances_that_take_it() -> None:
    (reason,) = row("casting, unnamed", "constant", 3).refused
    assert "tolerance.magnet_position_mm = 1" in reason
    assert "tolerance.magnet_tilt_deg = 5" in reason


@pytest.mark.parametrize("ambient", ["constant", "drifting"])
def test_steel_thimble_is_reported_and_never_published_as_ok(ambient: Ambient) -> None:
    found = row("thimble", ambient)
    assert found.wrong == 0, found.line
    assert found.false_contacts == 0, found.line
    said = sum(count for reason, count in found.reasons.items() if "steel" in reason)
    assert found.reasons
    if ambient == "constant":
        assert said > 0.95 * sum(found.reasons.values()), found.reasons


@pytest.mark.parametrize("seed", [11, 12])
def test_steel_at_the_first_frame_leaves_no_false_field_behind(seed: int) -> None:
    """Before, these untouched pads were disturbed between touches, and the first one then told 160 wrong frames. Half
    of the frames are touched. The first frame, which steel moves like a press, may be wrong."""
    found = row("thimble", "drifting", seed)
    assert found.wrong <= 1, found.line
    assert found.health["ok"] > 0.48 * found.frames, found.line
    assert found.health["degraded"] == 0, found.line


def test_chip_that_strong_field_left_magnetised_is_named_where_it_counts() -> None:
    """10 mG: under some presses it is named, else within the deviations."""
    found = row("disturbed chip", "constant")
    assert found.wrong == 0, found.line
    assert found.health["degraded"] > 0.05 * found.frames, found.line


def test_bit_that_flips_on_the_bus_is_in_one_frame_only() -> None:
    config = PadConfig(name="bus", source=SimulatedSource(finger="none", imperfections=("bit_errors",)))
    source = Simulated(config)
    source.finger, source.turning_rad_per_s, period_ns = no_finger, 0.0, round(1e9 / 220)
    counts = np.array([frame.counts for step in range(4400) for frame in source.poll(step * period_ns)], dtype=float)
    away = np.abs(counts - np.median(counts, axis=0))
    # Of 4400 frames of four readings, one in 2000 has a flipped bit; half of these bits are worth 32 counts or more.
    wrong = (away > 30.0).any(axis=2)
    assert 1 <= wrong.sum() <= 20
    assert away.max() <= 1024.0 + 30.0


def test_steps_of_a_chip_are_of_one_count() -> None:
    def fields(*imperfections: str) -> np.ndarray:
        source = Simulated(
            PadConfig(name="steps", source=SimulatedSource(finger="none", imperfections=imperfections)), noise_t=0.0
        )
        source.turning_rad_per_s = 0.0
        return np.array([f.field_t for step in range(2200) for f in source.poll(round(step * 1e9 / 220))])

    spread = np.ptp(fields("steps"), axis=0)
    assert np.ptp(fields("nonlinear"), axis=0).max() == 0.0
    assert 0.5 * STEP_T < spread.max() < 2.0 * STEP_T


def test_wide_finger_moves_magnet_less_above_it_and_ball_more() -> None:
    mechanics, press = standard_mechanics(), [np.array([0.0]), np.array([0.0]), np.array([1.0])]
    depth = {name: -float(shape.response(mechanics, press)[0, 2]) for name, shape in SHAPES.items()}
    assert depth["flat"] < depth["edge"] < depth["round"] < depth["ball"]
    # The mean over a slightly larger disc, from its points: second moments approximate it.
    wide = FingerShape((PATCH_MM2 + 0.5, PATCH_MM2 + 0.5))
    radius_m = np.sqrt(4.0 * 0.5) * 1e-3 * np.sqrt((np.arange(40) + 0.5) / 40)
    angle = np.arange(40) * 2.399963  # golden angle: spreads points evenly
    x_m, y_m = radius_m * np.cos(angle), radius_m * np.sin(angle)
    mean = mechanics.response(x_m, y_m, np.full(40, 1.0)).mean(axis=0)
    assert wide.response(mechanics, press)[0, 2] == pytest.approx(mean[2], rel=0.01)


def test_off_centre_magnet_moves_like_a_shifted_press() -> None:
    config = PadConfig(name="cast", source=SimulatedSource(imperfections=("casting",)))
    source = Simulated(config, perfect=True)
    built = source.built
    assert np.linalg.norm(built.magnet_off_m) == pytest.approx(1e-3)
    assert np.degrees(np.arccos(built.pad.rest_axis[2])) == pytest.approx(5.0, abs=0.01)
    middle = MountedPad.exact(config.pad())
    off, load = built.magnet_off_m, np.array([1.0])
    moved = built.response(np.array([2e-3 + off[0]]), np.array([off[1]]), load)
    np.testing.assert_allclose(moved, middle.response(np.array([2e-3]), np.array([0.0]), load))


def test_disabled_imperfections_change_no_frame() -> None:
    """The same frames as without the switches, so that a recording stays what it was."""
    plain, shaped = (
        Simulated(PadConfig(name="same", source=SimulatedSource(seed=4, finger_shape=shape)))
        for shape in ("round", "flat")
    )
    for source in (plain, shaped):
        source.finger = steady_finger(1e-3, 2e-3, 1.0)
    one, other = (source.poll(0)[0].counts for source in (plain, shaped))
    again = Simulated(PadConfig(name="same", source=SimulatedSource(seed=4)))
    again.finger = lambda time_s: Touch(1e-3, 2e-3, 1.0)
    np.testing.assert_array_equal(one, again.poll(0)[0].counts)
    assert (one != other).any()
