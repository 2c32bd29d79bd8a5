"""`baseline --turn`: gains from an unloaded robot that is turned in the Earth's field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mounted_world import TOLERANCE, World, turned

from fmfts.ambient.gains import relative_deviation
from fmfts.ambient.turn import Turn, gains_from_turn
from fmfts.pad import Pad

UNTESTED = replace(TOLERANCE, gain=0.05)


def _world(pad: Pad, seed: int) -> World:
    world = World(pad, np.random.default_rng(seed))
    world.spoilt(UNTESTED.gain)
    return world


@pytest.fixture(scope="module")
def turns() -> list[tuple[World, Turn]]:
    from fmfts.config import PadConfig, SimulatedSource

    worlds = [_world(PadConfig(name="standard", source=SimulatedSource()).pad(), seed) for seed in range(20)]
    return [(world, Turn.of(turned(world))) for world in worlds]


def test_gains_are_found_as_well_as_claimed(turns: list[tuple[World, Turn]]) -> None:
    errors, deviations, normalised = [], [], []
    for world, turn in turns:
        gains = gains_from_turn(world.pad, UNTESTED, turn)
        error = (gains.mean - world.gain).ravel()
        errors.append(error - error.mean())
        deviations.append(relative_deviation(gains.covariance))
        normalised.append(error @ np.linalg.solve(gains.covariance, error))
    reached, claimed = np.sqrt(np.mean(np.square(errors))), np.sqrt(np.mean(np.square(deviations)))
    print(reached, claimed, np.mean(normalised))
    # From 5 %: what a workshop's field, uneven by half a percent, leaves of the ratios between x, y and z.
    assert reached < 0.006
    assert claimed == pytest.approx(reached, rel=0.5)
    # The mean of 20 χ²₁₂ has a deviation of 1.1; a field that is smoother than assumed lowers it.
    assert 12.0 - 7.0 < np.mean(normalised) < 12.0 + 4 * 1.1
