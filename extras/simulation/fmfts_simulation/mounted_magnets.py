"""The magnets of a simulated pad with several, and their field under one or two fingers.

A magnet that was cast off its place reacts to a press like a magnet in its place to a shifted press. Fingers add up:
lab/results/several.md has how far that holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fmfts.config import PadConfig
from fmfts.contact.array_model import ARRAY_PATH, standard_magnets_of
from fmfts.contact.array_response import CHANGE, ArrayResponse
from fmfts.pad import Array, Pad
from fmfts.pose.magnets import Magnets, rest_frames
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.finger import Finger, Touch
from fmfts_simulation.mounted import MAGNET_PLACE_M, MAGNET_TILT_RAD, REMANENCE

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
    def of(cls, config: PadConfig, random: np.random.Generator | None) -> MountedMagnets:
        """A pad with random building errors; without errors if `random` is None. ValueError where no such pad is
        simulated.
        """
        drawing = config.pad()
        return cls.built(drawing, _response_of(drawing), random)

    @classmethod
    def built(cls, drawing: Pad, response: ArrayResponse, random: np.random.Generator | None) -> MountedMagnets:
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
        """(N, 3) in pad axes at places (N, 3) under fingers at once. warmer: factor on all remanences."""
        return self.field_at(place_m, [touches], warmer)

    def field_at(self, place_m: Array, touches: Sequence[Sequence[Touch]], warmer: float) -> Array:
        """As `field`, at each place under fingers of its own; of one set of fingers, all places under these."""
        field_t = np.zeros((len(place_m), 3))
        for one in self.fields_of(self.moved(touches), place_m, warmer):
            field_t += one
        return field_t

    def moved(self, touches: Sequence[Sequence[Touch]]) -> list[Magnets]:
        """The magnets under each of these sets of fingers."""
        each = list(dict.fromkeys(touch for own in touches for touch in own))  # a still finger: once
        changes = dict(zip(each, self._changes(each), strict=True))
        rest = np.zeros((len(self.remanence_t), CHANGE))
        sums = (sum((changes[touch] for touch in own), rest) for own in touches)
        return [self.magnets.changed((change * MM).ravel(), self.frames) for change in sums]

    def _changes(self, touches: Sequence[Touch]) -> Array:
        """The changes (T, M, 5) of the magnets under each finger alone."""
        count = len(self.remanence_t)
        changes = np.zeros((len(touches), count, CHANGE))
        pressing = [number for number, one in enumerate(touches) if one.force_n or one.shear_x_n or one.shear_y_n]
        if not pressing:
            return changes
        place_mm = 1e3 * np.array([(touches[number].x_m, touches[number].y_m) for number in pressing])
        force_n = np.repeat([touches[number].force_n for number in pressing], count)
        shear_n = np.array([(touches[number].shear_x_n, touches[number].shear_y_n) for number in pressing])
        x_mm, y_mm = (place_mm[:, None] - self.off_mm).reshape(-1, 2).T
        pressed = self.response.pressed_alone(x_mm, y_mm, force_n)
        # A press at each magnet's place, and only its effect on that magnet.
        each = np.arange(count)
        own = pressed.change.reshape(-1, count, count, CHANGE)[:, each, each]
        by_shear = pressed.by_shear.reshape(-1, count, count, CHANGE, 2)[:, each, each]
        changes[pressing] = own + by_shear[..., 0] * shear_n[:, None, :1] + by_shear[..., 1] * shear_n[:, None, 1:]
        return changes

    def fields_of(self, moved: Sequence[Magnets], place_m: Array, warmer: float) -> list[Array]:
        """As `field_at`, for each magnet alone. moved: the magnets at each place, or once for all places."""
        position_m, axis = np.array([one.position_m for one in moved]), np.array([one.axis for one in moved])
        remanences_t = (self.remanence_t * warmer).tolist()
        magnets = [one.magnet.with_remanence(own) for one, own in zip(self.drawing.magnets, remanences_t, strict=True)]
        return [
            cylinder_field(place_m, position_m[:, number], axis[:, number], magnet)
            for number, magnet in enumerate(magnets)
        ]


def _response_of(drawing: Pad) -> ArrayResponse:
    """The shipped table, for those of its magnets that the pad holds: each moves as if the others were not there."""
    response = ArrayResponse.of(ARRAY_PATH.read_bytes(), str(ARRAY_PATH))
    held = standard_magnets_of(drawing, response)
    if held is None:
        raise ValueError(
            f"pad '{drawing.name}': of pads with several magnets only those are simulated that hold two to four of the "
            "magnets of docs/several.md"
        )
    return response.only(held)


@dataclass(slots=True)
class FieldOfFingers:
    """Remembers the field that it computed last: it changes only when a finger, the places or the temperature do."""

    inside: MountedMagnets
    _known: object = None
    _field_t: Array = field(default_factory=lambda: np.empty(0))

    def at(self, place_m: Array, sampled_s: Array, fingers: Sequence[Finger], warmer: float) -> Array:
        """(N, 3) in pad axes at places (N, 3), each at its own time (N,). warmer: factor on all remanences."""
        touches = [[finger(moment) for finger in fingers] for moment in sampled_s.tolist()]
        now = place_m.tobytes(), touches, warmer
        if now != self._known:
            if all(each == touches[0] for each in touches):
                self._field_t = self.inside.field(place_m, touches[0], warmer)
            else:
                self._field_t = self.inside.field_at(place_m, touches, warmer)
            self._known = now
        return self._field_t
