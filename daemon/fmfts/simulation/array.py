"""Simulates a pad with several magnets, and one or two fingers on it.

A magnet that was cast beside its place feels a press as one in its place feels a press beside. Fingers add up: docs/
results/several.md has how far that holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact.array_model import ARRAY_PATH, ArrayModel
from fmfts.contact.array_response import CHANGE, ArrayResponse
from fmfts.contact.contract import ModelError
from fmfts.pad import Array, Pad, SensorArray, rotation_from_vector
from fmfts.pose.magnets import Magnets, rest_frames
from fmfts.simulation.cylinder import cylinder_field
from fmfts.simulation.finger import Finger, MeetingFingers, Touch
from fmfts.simulation.mounted import (
    EARTH_T,
    GAIN,
    MAGNET_PLACE_M,
    MAGNET_TILT_RAD,
    REMANENCE,
    SENSOR_PLACE_M,
    MountedPad,
)
from fmfts.simulation.source import Simulated

MM = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class MountedMagnets:
    """The magnets of a built pad at rest. frames (M, 3, 3): see `rest_frames`. remanence_t (M,). off_mm (M, 2): how far
    each one is cast beside its place."""

    drawing: Pad
    response: ArrayResponse
    magnets: Magnets
    frames: Array
    remanence_t: Array
    off_mm: Array

    @classmethod
    def built(cls, drawing: Pad, response: ArrayResponse, random: np.random.Generator | None) -> Self:
        """With random building errors; without, if `random` is None."""
        drawn, count = Magnets.drawn(drawing), len(drawing.magnets)
        frames = rest_frames(drawn.axis)
        remanence_t = np.array([one.magnet.remanence_t for one in drawing.magnets])
        if random is None:
            return cls(drawing, response, drawn, frames, remanence_t, np.zeros((count, 2)))
        off = np.concatenate(
            [random.normal(0.0, MAGNET_PLACE_M, (count, 3)), random.normal(0.0, MAGNET_TILT_RAD, (count, 2))], axis=1
        )
        remanence_t = remanence_t * random.normal(1.0, REMANENCE, count)
        magnets = drawn.changed(off.ravel(), frames)
        return cls(drawing, response, magnets, rest_frames(magnets.axis), remanence_t, off[:, :2] * 1e3)

    def field(self, place_m: Array, touches: Sequence[Touch], warmer: float) -> Array:
        """(N, 3) in pad axes under fingers at once. warmer: factor on all remanences."""
        count = len(self.remanence_t)
        change = np.zeros((count, CHANGE))
        for touch in touches:
            if touch.force_n == 0.0 and touch.shear_x_n == 0.0 and touch.shear_y_n == 0.0:
                continue
            for number, (x, y) in enumerate(self.off_mm.tolist()):
                pressed = self.response.pressed(touch.x_m * 1e3 - x, touch.y_m * 1e3 - y, touch.force_n)
                own = pressed.change + pressed.by_shear @ np.array([touch.shear_x_n, touch.shear_y_n])
                change[number] += own.reshape(count, CHANGE)[number]
        moved = self.magnets.changed((change * MM).ravel(), self.frames)
        field_t = np.zeros((len(place_m), 3))
        for number, one in enumerate(self.drawing.magnets):
            magnet = one.magnet.with_remanence(float(self.remanence_t[number]) * warmer)
            field_t += cylinder_field(place_m, moved.position_m[number], moved.axis[number], magnet)
        return field_t


class SimulatedArray(Simulated):
    """A Source of one simulated pad with several magnets. second_finger: presses besides `finger`; None: none does."""

    def __init__(
        self,
        config: PadConfig,
        beside: Sequence[PadConfig] = (),
        *,
        noise_t: float | None = None,
        perfect: bool = False,
    ) -> None:
        super().__init__(config, beside, noise_t=noise_t, perfect=perfect)
        self.second_finger: Finger | None = None
        source = config.source
        assert isinstance(source, SimulatedSource)
        if source.fingers == 2 and source.finger == "script":
            both = MeetingFingers(source.seed)
            self.finger, self.second_finger = both.staying, both.coming

    def _build(
        self, config: PadConfig, source: SimulatedSource, random: np.random.Generator, perfect: bool
    ) -> MountedPad:
        drawing = config.pad()
        try:
            response = ArrayModel.load(ARRAY_PATH, drawing).response
        except ModelError as error:
            raise ValueError(f"pad '{config.name}': only the shipped pad with several magnets is simulated") from error
        self.inside = MountedMagnets.built(drawing, response, None if perfect else random)
        if perfect:
            return MountedPad(drawing, np.ones((len(drawing.sensors), 3)), np.zeros(3), np.eye(3))
        sensors, tolerance = drawing.sensors, config.tolerance.si()
        shape = sensors.position_m.shape
        turns = [rotation_from_vector(one) for one in random.normal(0.0, tolerance.sensor_rotation_rad, shape)]
        turned = SensorArray(
            sensors.position_m + random.normal(0.0, SENSOR_PLACE_M, shape), sensors.axes @ np.array(turns)
        )
        upper = np.triu(random.normal(0.0, tolerance.cross_axis, (*shape, 3)), 1)
        ambient = random.standard_normal(3)
        built = Pad(
            drawing.name,
            turned,
            drawing.magnet,
            drawing.rest_position_m,
            drawing.rest_axis,
            drawing.chip,
            drawing.silicone,
        )
        gain = random.normal(1.0, GAIN, shape)
        ambient_t = EARTH_T * ambient / np.linalg.norm(ambient)
        return MountedPad(built, gain, ambient_t, np.eye(3), cross_axis=upper + upper.transpose(0, 2, 1))

    def _magnet_field(self, sampled_s: Array, warming_k: float) -> Array:
        """(N, 3) field of the magnets; computed again only when a finger or the temperature changes."""
        places = self._built.pad.sensors.position_m
        fingers = [self.finger] if self.second_finger is None else [self.finger, self.second_finger]
        now = ([[finger(moment) for finger in fingers] for moment in sampled_s.tolist()], warming_k)
        known, field_t = self._known
        if now != known:
            warmer = 1.0 + self._magnet_per_k * warming_k
            first = now[0][0]
            if all(each == first for each in now[0]):
                field_t = self.inside.field(places, first, warmer)
            else:
                each = [self.inside.field(places[i : i + 1], touches, warmer)[0] for i, touches in enumerate(now[0])]
                field_t = np.array(each)
            self._known = now, field_t
        return field_t

    _known: tuple[object, Array] = (None, np.empty(0))


def simulated_pad(config: PadConfig, beside: Sequence[PadConfig] = ()) -> Simulated:
    """The simulated source of a pad with one magnet or with several."""
    return SimulatedArray(config, beside) if config.other_magnets else Simulated(config, beside)
