"""Built pads with several magnets, and the fields of fingers on them, frame by frame, for `several`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fmfts.baseline.array_mounting import ArrayMounting, estimate_array_mounting
from fmfts.baseline.recording import Recording
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.config import PadConfig
from fmfts.contact.array_model import ARRAY_PATH, ArrayModel
from fmfts.contact.array_response import CHANGE, ArrayResponse
from fmfts.pad import Array, Pad, SensorArray, Tolerance, rotation_from_vector
from fmfts.pose import Aligned
from fmfts.pose.magnets import Magnets, field_of, rest_frames
from fmfts.sensor.chips.hmc5983 import HMC5983
from fmfts.several.count import FingerCounter
from fmfts.several.estimator import FingersEstimator
from fmfts.several.field_model import MM, FieldModel, Scene
from fmfts.several.fit import Fitter, Measured
from fmfts.several.reading import FingersMemory, FingersReading
from fmfts.several.recovery import Recovery
from fmfts_lab.finite_elements.array_pad import array_config

NOISE_T = HMC5983.noise_t
RATE_HZ = 220.0
EARTH_T = 5e-5
BASELINE_FRAMES = 660
WITHIN_MM = 11.0  # fingers press within this of the middle, along x and y
SCENE = Scene(ambient_t=1e-4, moment=2.5e-3, friction=0.3)
EXACT = Tolerance(1e-9, 1e-9, 1e-9, 1e-7, 1e-7)
BUILT = Tolerance(1e-4, 1e-4, float(np.deg2rad(1.0)), 0.005, 0.01)  # 0.1 mm, 1°, gains of a self-test
BY_HAND = Tolerance(1e-4, 1e-4, float(np.deg2rad(1.0)), 0.05, 0.1, float(np.deg2rad(1.5)), 0.005)


class Press(NamedTuple):
    """One finger. patch_mm: the diameter of what it touches; the table is of 6 mm."""

    x_mm: float
    y_mm: float
    force_n: float
    shear_x_n: float = 0.0
    shear_y_n: float = 0.0
    patch_mm: float = 6.0


@dataclass(frozen=True, slots=True)
class World:
    """One built pad, with the estimator that its own baseline gives."""

    magnets: Magnets
    frames: Array
    off_mm: Array
    sensors: SensorArray
    gain: Array
    ambient_t: Array
    response: ArrayResponse
    mounting: ArrayMounting
    fitter: Fitter
    random: np.random.Generator

    def counter(self) -> FingerCounter:
        return FingerCounter(self.fitter, RATE_HZ)

    def pressed(self, presses: list[Press]) -> Array:
        """(20,) the change of the poses, in SI. A mean of x² over the patch other than the table's counts by the
        Laplacian: the patch of diameter d has d²/16."""
        count = len(self.magnets)
        change = np.zeros((count, CHANGE))
        for press in presses:
            wider_mm2 = (press.patch_mm * press.patch_mm - 36.0) / 16.0
            for number, (x, y) in enumerate(self.off_mm.tolist()):
                one = self.response.pressed(press.x_mm - x, press.y_mm - y, press.force_n)
                shear = one.by_shear @ np.array([press.shear_x_n, press.shear_y_n])
                own = one.change + 0.5 * wider_mm2 * one.laplacian + shear
                change[number] += own.reshape(count, CHANGE)[number]
        return np.asarray((change * MM).ravel())

    def sensed(self, change: Array, ambient_t: Array) -> Array:
        """(N, 3) what the chips report of one frame."""
        field = self._field(self.magnets.changed(change, self.frames), ambient_t)
        return np.asarray(field + self.random.normal(0.0, NOISE_T, field.shape))

    def measured(self, change: Array, ambient_t: Array | None = None) -> Measured:
        """One frame of a pad whose magnets have moved by `change` (20,), in another ambient field if there is one."""
        field = self.sensed(change, self.ambient_t if ambient_t is None else ambient_t)
        mounting = self.mounting
        return Measured(
            (mounting.magnet_field(field) - mounting.rest_field_t).ravel(),
            np.square(mounting.noise_t / mounting.gain).ravel(),
            np.ones(field.size, dtype=np.bool_),
        )

    def _field(self, magnets: Magnets, ambient_t: Array) -> Array:
        own = field_of(magnets, self.sensors) + self.sensors.to_sensor(np.tile(ambient_t, (len(self.sensors), 1)))
        return np.asarray(self.gain * own)


def world(seed: int, tolerance: Tolerance, friction: float = SCENE.friction, layout: PadConfig | None = None) -> World:
    """A pad built with errors of `tolerance`, and its baseline, bare and rest. friction: that the estimator expects.

    layout: the standard pad, or one with some of its magnets, and other sensors.
    """
    random = np.random.default_rng((seed, 23))
    drawing = (layout or array_config()).pad()
    response = response_of(drawing)
    drawn, count = Magnets.drawn(drawing), len(drawing.sensors)
    off = np.concatenate(
        [
            random.normal(0.0, tolerance.magnet_position_m, (len(drawn), 3)),
            random.normal(0.0, tolerance.magnet_tilt_rad, (len(drawn), 2)),
        ],
        axis=1,
    )
    magnets = drawn.stronger(random.normal(0.0, tolerance.remanence, len(drawn))).changed(
        off.ravel(), rest_frames(drawn.axis)
    )
    places = drawing.sensors.position_m + random.normal(0.0, tolerance.sensor_position_m, (count, 3))
    turns = np.array(
        [rotation_from_vector(one) for one in random.normal(0.0, tolerance.sensor_rotation_rad, (count, 3))]
    )
    sensors, gain = SensorArray(places, turns), random.normal(1.0, tolerance.gain, (count, 3))
    ambient = random.standard_normal(3)
    ambient_t = EARTH_T * ambient / np.linalg.norm(ambient)

    def recorded(field: Array) -> Recording:
        mean = gain * field + random.normal(0.0, NOISE_T / np.sqrt(BASELINE_FRAMES), field.shape)
        every = np.full(count, BASELINE_FRAMES)
        return Recording(mean, np.full(field.shape, NOISE_T), every, 0, 25.0, 3.0)

    bare = sensors.to_sensor(np.tile(ambient_t, (count, 1)))
    mounting = estimate_array_mounting(
        drawing,
        tolerance,
        recorded(bare + field_of(magnets, sensors)),
        recorded(bare),
        Sensitivity.untested(count, tolerance),
    )
    fitter = Fitter(FieldModel(drawing, mounting, response, replace(SCENE, friction=friction)))
    return World(
        magnets,
        rest_frames(magnets.axis),
        off[:, :2] * 1e3,
        sensors,
        gain,
        ambient_t,
        response,
        mounting,
        fitter,
        random,
    )


def response_of(drawing: Pad) -> ArrayResponse:
    """The shipped table, for the magnets of `drawing` alone: each one moves as if the others were not there."""
    standard = array_config().pad()
    response = ArrayModel.load(ARRAY_PATH, standard).response
    places = [one.rest_position_m.tolist() for one in standard.magnets]
    return response.only([places.index(one.rest_position_m.tolist()) for one in drawing.magnets])


def estimator_of(one: World) -> FingersEstimator:
    """For `read_once`: a pad's estimator takes longer to make than to read a frame."""
    without_end = np.full(one.gain.shape, np.inf)
    pad = array_config().pad()
    return FingersEstimator(FieldModel(pad, one.mounting, one.response, SCENE), RATE_HZ, without_end)


def read_once(one: World, change: Array, estimator: FingersEstimator | None = None) -> FingersReading:
    """A pad's result for one frame, without memory."""
    shape, estimator = one.gain.shape, estimator or estimator_of(one)
    estimator.recall(FingersMemory(Recovery(np.zeros(one.gain.size))))
    field = one.sensed(change, one.ambient_t)
    aligned = Aligned(field, np.ones((shape[0], 1)), np.zeros(shape), 0, np.zeros(shape, dtype=np.int64))
    return estimator.read(aligned, None, {})


def worlds(frames: int, tolerance: Tolerance, seed: int, of_a_pad: int) -> Iterator[World]:
    """Enough pads for this many frames."""
    for number in range(-(-frames // of_a_pad)):
        yield world(1000 * seed + number, tolerance)


def two_places(random: np.random.Generator, apart_mm: float) -> Array:
    """Two places (2, 2), so far apart, on the pad's inner part."""
    while True:
        one, angle = random.uniform(-WITHIN_MM, WITHIN_MM, 2), random.uniform(0.0, 2.0 * np.pi)
        other = one + apart_mm * np.array([np.cos(angle), np.sin(angle)])
        if np.abs(other).max() <= WITHIN_MM:
            return np.array([one, other])


def any_press(random: np.random.Generator) -> Press:
    """One finger: patches of 4 to 8 mm, friction up to 0.3 in any direction, 0.1 to 2 N, on the pad's inner part."""
    force, angle = random.uniform(0.1, 2.0), random.uniform(0.0, 2.0 * np.pi)
    shear = force * random.uniform(0.0, 0.3) * np.array([np.cos(angle), np.sin(angle)])
    x, y = random.uniform(-WITHIN_MM, WITHIN_MM, 2).tolist()
    return Press(x, y, force, float(shear[0]), float(shear[1]), random.uniform(4.0, 8.0))
