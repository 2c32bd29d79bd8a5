"""Pads of which only a sketch is known: sensors up to 2 mm and 10° from their drawing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from mounted_world import NOISE_T, TOLERANCE, World

from fmfts.baseline import Baseline, Means, make_bare, make_rest
from fmfts.pad import Pad, rotation_from_vector
from fmfts_calibrate.learn.fit import Fields

PLACE_M, ROTATION_RAD = 2e-3, np.radians(10.0)
SKETCH = replace(
    TOLERANCE,
    gain=0.05,
    cross_axis=0.005,
    remanence=0.1,
    sensor_position_m=PLACE_M / np.sqrt(3.0),
    sensor_rotation_rad=ROTATION_RAD / np.sqrt(3.0),
)
MEAN_OF = 11


def rough_world(pad: Pad, seed: int) -> World:
    world = World(pad, np.random.default_rng(seed))
    world.spoilt(replace(SKETCH, sensor_rotation_rad=0.0, cross_axis=0.002))
    vectors = world.random.uniform(-ROTATION_RAD, ROTATION_RAD, (4, 3))
    world.turned = np.array([rotation_from_vector(one) for one in vectors])
    world.places = pad.sensors.position_m + world.random.uniform(-PLACE_M, PLACE_M, (4, 3))
    return world


def presses(world: World, count: int = 60, reach_m: float = 11e-3) -> Means:
    """Averages of steady presses anywhere, as `means` makes them."""
    random = world.random
    x_m, y_m = random.uniform(-reach_m, reach_m, (2, count))
    states = world.pressed(x_m, y_m, random.uniform(0.2, 2.0, count))
    fields = np.array([world.field(state) + world.sensed(world.surroundings()) for state in states])
    noisy = fields + random.normal(0.0, NOISE_T / np.sqrt(MEAN_OF), fields.shape)
    return Means(noisy, np.zeros(count), np.arange(count) * 0.05, np.full((4, 3), NOISE_T))


def bare_and_rest(world: World) -> Baseline:
    bare = make_bare(world.pad, SKETCH, world.recorded(world.bare()))
    return make_rest(world.pad, SKETCH, world.recorded(world.field()), bare)[0]


def fields(world: World, pressed: Means) -> Fields:
    """The fields for `learn`, without the ambient field."""
    bare, deviation = world.bare(), np.full((4, 3), np.hypot(NOISE_T / np.sqrt(MEAN_OF), 1e-7))
    return Fields(world.field() - bare, pressed.field_t - bare, np.full((4, 3), 1.5e-7), deviation)
