"""A baseline that follows a drift by itself: drifts are followed, and a load is never learnt beyond the bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from fmfts.config import Imperfection, PadConfig, RebaselineConfig, SceneConfig, SimulatedSource
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.rebaselining import Rebaselining
from fmfts.scene.tracking import tracking_model_for
from fmfts_lab.bench.drills import AS_DRAWN
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger
from fmfts_simulation.source import Simulated

# Slow enough to run through ten minutes of a pad's life in seconds.
RATE_HZ = 20
LIMITS = RebaselineConfig(enabled=True, quiet_s=20.0, rate_um_per_hour=180.0, limit_um=30.0, force_below_n=0.1)
LIMIT_M, RATE_M_PER_S = 30e-6, 180e-6 / 3600.0
# Rest's distance from 30 µm downward, in newtons, in the middle of this pad: 3.5 µm are a deviation, and five of them
# are 16 mN (physics of the pad); plus the uncertainty of a mean of twenty frames.
LIMIT_N = 0.04
Ageing = Callable[[float], float]


@dataclass
class Run:
    """The health of the last minute, and the movement of the rest at any time."""

    forces_n: list[float] = field(default_factory=list)
    heights_m: list[float] = field(default_factory=list)
    sizes_m: list[float] = field(default_factory=list)
    final_m: np.ndarray = field(default_factory=lambda: np.zeros(5))


def life(
    seconds: float,
    finger: Finger = no_finger,
    share: Ageing = lambda time_s: 1.0,
    on: bool = True,
    turning_deg_per_s: float = 0.0,
    creeps: bool = False,
) -> Run:
    """share: of the magnet's moment that is left. creeps: the silicone is no spring."""
    imperfections: tuple[Imperfection, ...] = ("silicone",) if creeps else ()
    source_config = SimulatedSource(rate_hz=RATE_HZ, turning_deg_per_s=turning_deg_per_s, imperfections=imperfections)
    config = PadConfig(name="left", source=source_config, scene=SceneConfig(), tolerance=AS_DRAWN, rebaseline=LIMITS)
    drawing = config.pad()
    tracking = tracking_model_for(config.scene, config.magnet).tracking
    pipeline = PadPipeline(drawing, load_contact_model(config), "boot", float(RATE_HZ), tracking)
    baseline = simulated_baseline(config)
    mounting = pipeline.use(baseline)
    rebaselining = Rebaselining(pipeline, baseline, mounting, config.rebaseline.si())
    source, run = Simulated(config), Run()
    source.finger = finger
    built, magnet = source.built, source.built.pad.magnet
    count = round(seconds * RATE_HZ)
    for number in range(count):
        if number % RATE_HZ == 0:
            aged = magnet.with_remanence(magnet.remanence_t * share(number / RATE_HZ))
            source._built = replace(built, pad=replace(built.pad, magnet=aged))
        for frame in source.poll(number * round(1e9 / RATE_HZ)):
            answer = pipeline.answer(frame)
            message = message_of(answer)
            if on:
                rebaselining.saw(answer)
                run.sizes_m.append(rebaselining.size_m)
            if number > count - 30 * RATE_HZ and message.force_n is not None and message.pose is not None:
                run.forces_n.append(message.force_n)
                assert pipeline.mounting is not None
                run.heights_m.append(message.pose.position_m[2] - pipeline.mounting.rest.position_m[2])
    return run


def ageing(time_s: float) -> float:
    """0.25 % in six minutes, then no more: 18 µm of height."""
    return 1.0 - 0.0025 * min(time_s / 360.0, 1.0)


@pytest.mark.long
def test_ageing_moment_is_followed() -> None:
    left, followed = life(600.0, share=ageing, on=False), life(600.0, share=ageing)
    assert abs(np.mean(left.heights_m)) > 10e-6
    assert abs(np.mean(followed.heights_m)) < 0.35 * abs(np.mean(left.heights_m))


@pytest.mark.long
def test_ageing_moment_is_followed_on_robot_that_turns_all_time() -> None:
    """18 µm are what the pad would have sunk by, as on one that stands."""
    followed = life(600.0, share=ageing, turning_deg_per_s=20.0)
    assert abs(np.mean(followed.heights_m)) < 6e-6
    assert followed.sizes_m[-1] > 12e-6


@pytest.mark.long
def test_creep_of_the_silicone_is_followed() -> None:
    """It looks like a press of 10 mN that comes in six minutes, and stays."""

    def creep(time_s: float) -> Touch:
        return Touch(0.0, 0.0, 0.01 * min(time_s / 360.0, 1.0))

    left, followed = life(600.0, creep, on=False), life(600.0, creep)
    assert abs(np.mean(followed.heights_m)) < 0.5 * abs(np.mean(left.heights_m))


def test_constant_rest_is_not_moved() -> None:
    run = life(200.0)
    assert max(run.sizes_m) < 5e-6


def test_rate_is_never_exceeded() -> None:
    """0.15 % at once are 11 µm. Twice as much would be a touch, of which nothing is learnt."""
    run = life(300.0, share=lambda time_s: 0.9985)
    steps = np.diff(run.sizes_m)
    assert max(run.sizes_m) > 5e-6
    assert steps.max() <= RATE_M_PER_S * 21.0
    assert max(run.sizes_m) <= RATE_M_PER_S * 300.0


@pytest.mark.parametrize("mn_per_s", [*(pytest.param(slow, marks=pytest.mark.long) for slow in (0.03, 0.1)), 1.0])
def test_slow_press_is_learned_at_most_to_the_limit(mn_per_s: float) -> None:
    """At 1 mN/s nothing of it is learnt at all."""
    seconds = 100.0 if mn_per_s >= 1.0 else 300.0

    def slowly(time_s: float) -> Touch:
        return Touch(0.0, 0.0, mn_per_s * 1e-3 * time_s)

    run = life(seconds, slowly)
    true_n = mn_per_s * 1e-3 * (seconds - 15.0)
    assert max(run.sizes_m) <= LIMIT_M * (1.0 + 1e-9)
    assert np.mean(run.forces_n) > true_n - LIMIT_N
    if mn_per_s >= 1.0:
        assert max(run.sizes_m) < 3e-6


def test_held_press_is_never_learned() -> None:
    run = life(300.0, lambda time_s: Touch(0.0, 0.0, 0.1 if time_s > 2.0 else 0.0))
    assert max(run.sizes_m) < 1e-6
    assert np.mean(run.forces_n) == pytest.approx(0.1, abs=0.03)
