"""Draws a pad for Foxglove's 3-D panel: its sensors, magnet and contact, as channels beside those of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgspec

from fmfts.config.pad_facts import pad_facts
from fmfts_recording.finger_columns import FingerColumns
from fmfts_recording.foxglove import (
    Arrow,
    Box,
    Color,
    Cylinder,
    Deletion,
    Entity,
    FrameTransform,
    Pose,
    PoseInFrame,
    PosesInFrame,
    Quaternion,
    SceneUpdate,
    Text,
    Time,
    Vector3,
    rotation_of,
    time_of,
    turning,
    vector,
)
from fmfts_recording.pad_config import recorded_pad

WORLD = "fmfts"  # the frame that all placements share
SHOWN_HZ = 30.0
PLACED_S = 1.0  # a player that begins in the middle needs the pad's frame and its still parts soon
# 95 % of a normal distribution: √χ² of 2 and of 3 degrees of freedom. The drawn ellipse is along the axes of the pad.
ELLIPSE_DEVIATIONS, ELLIPSOID_DEVIATIONS = 2.4477, 2.7955
ARROW_M_PER_N = 0.02
CHIP_M = 0.003
TOWARD_FINGER, ALONG_X = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
SILICONE, CHIP, MAGNET = Color(r=0.6, g=0.7, b=0.8, a=0.25), Color(r=0.1, g=0.4, b=0.2), Color(r=0.5, g=0.5, b=0.55)
TOUCH, UNCERTAIN, WARNING = Color(r=0.9, g=0.3, b=0.1), Color(r=0.9, g=0.5, b=0.1, a=0.35), Color(r=0.8, g=0.1, b=0.1)


class Wrench(msgspec.Struct, frozen=True, kw_only=True):
    """The finger's force on the pad, in newton, in the pad's frame: a press is negative along z.

    Foxglove has no schema for a wrench. An unknown part is left out.
    """

    timestamp: Time
    frame_id: str
    force_x_n: float | None
    force_y_n: float | None
    force_z_n: float


@dataclass(frozen=True, slots=True)
class Drawn:
    """A message for the channel `topic`, of Foxglove's (or this module's) schema `schema`."""

    topic: str
    schema: str
    message: msgspec.Struct


class PadScene:
    """The drawing of one pad. facts: as `pads` of the control socket tells them."""

    def __init__(self, pad: str, facts: dict[str, Any]) -> None:
        self._pad, self._facts = pad, facts
        self._shown_ns = self._placed_ns = 0
        self._columns = FingerColumns()

    @classmethod
    def of_state(cls, pad: str, config: dict[str, Any]) -> PadScene:
        """The scene of the configuration in a StateMessage. Raises msgspec.ValidationError: it is another version's."""
        return cls(pad, pad_facts(recorded_pad(config)))

    def contact(self, body: dict[str, Any]) -> Iterator[Drawn]:
        """The drawing of a ContactMessage; nothing if the last one was drawn less than 1/SHOWN_HZ ago."""
        now_ns = body["utc_ns"]
        if 0 <= now_ns - self._shown_ns < 1e9 / SHOWN_HZ:
            return
        self._shown_ns = now_ns
        time = time_of(now_ns)
        if not 0 <= now_ns - self._placed_ns < PLACED_S * 1e9:
            self._placed_ns = now_ns
            yield Drawn(f"transform/{self._pad}", "foxglove.FrameTransform", self._transform(time))
            yield self._update(time, [self._still(time)], [])
        entities = [
            each for each in (self._magnet(time, body), self._touch(time, body), self._health(time, body)) if each
        ]
        absent = {"magnet", "contact", "health"} - {each.id for each in entities}
        yield self._update(time, entities, sorted(absent))
        if (pose := body["pose"]) is not None:
            message = PoseInFrame(timestamp=time, frame_id=self._pad, pose=_placed(pose))
            yield Drawn(f"magnet/{self._pad}", "foxglove.PoseInFrame", message)
        if poses := body.get("poses"):
            magnets = PosesInFrame(timestamp=time, frame_id=self._pad, poses=tuple(map(_placed, poses)))
            yield Drawn(f"magnets/{self._pad}", "foxglove.PosesInFrame", magnets)
        if (contacts := body.get("contacts")) is not None:
            fingers = self._columns.fingers(time, self._pad, contacts, bool(body.get("more")))
            yield Drawn(f"fingers/{self._pad}", "fmfts.fingers", fingers)
        if body["force_n"] is not None and not body["over_range"]:
            wrench = Wrench(
                timestamp=time, frame_id=self._pad, force_z_n=-body["force_n"],
                force_x_n=body["shear_x_n"], force_y_n=body["shear_y_n"],
            )  # fmt: skip
            yield Drawn(f"wrench/{self._pad}", "fmfts.wrench", wrench)

    def _update(self, time: Time, entities: list[Entity], deleted: list[str]) -> Drawn:
        deletions = tuple(Deletion(timestamp=time, id=each) for each in deleted)
        return Drawn(
            f"scene/{self._pad}",
            "foxglove.SceneUpdate",
            SceneUpdate(deletions=deletions, entities=tuple(entities)),
        )

    def _transform(self, time: Time) -> FrameTransform:
        return FrameTransform(
            timestamp=time,
            parent_frame_id=WORLD,
            child_frame_id=self._pad,
            translation=vector(self._facts["placement_m"]),
            rotation=rotation_of(self._facts["placement_rotation"]),
        )

    @property
    def _height_m(self) -> float:
        return float(self._facts["rest_position_m"][2])

    def _still(self, time: Time) -> Entity:
        """Sensors, and a box around them and the resting magnet: the silicone's shape is in no configuration."""
        sensors = self._facts["sensors_m"]
        reach_x, reach_y = (2 * max(abs(place[axis]) for place in sensors) for axis in (0, 1))
        box = Box(
            pose=Pose(position=Vector3(z=self._height_m / 2)),
            size=Vector3(x=2 * reach_x, y=2 * reach_y, z=self._height_m),
            color=SILICONE,
        )
        chips = [
            Box(pose=Pose(position=vector(place)), size=Vector3(x=CHIP_M, y=CHIP_M, z=CHIP_M / 3), color=CHIP)
            for place in sensors
        ]
        return Entity(timestamp=time, frame_id=self._pad, id="pad", cubes=(box, *chips))

    def _magnet(self, time: Time, body: dict[str, Any]) -> Entity | None:
        """The magnet, or all of a pad with several."""
        poses = body.get("poses") or [each for each in (body["pose"],) if each is not None]
        if not poses:
            return None
        diameter_m, length_m = self._facts["magnet_diameter_m"], self._facts["magnet_length_m"]
        shape = Vector3(x=diameter_m, y=diameter_m, z=length_m)
        magnets = tuple(Cylinder(pose=_placed(pose), size=shape, color=MAGNET) for pose in poses)
        ellipsoids = tuple(
            Box(
                pose=Pose(position=vector(pose["position_m"])),
                size=vector([2 * ELLIPSOID_DEVIATIONS * part for part in pose["position_sd_m"]]),
                color=UNCERTAIN,
            )
            for pose in poses
        )
        return Entity(timestamp=time, frame_id=self._pad, id="magnet", cylinders=magnets, spheres=ellipsoids)

    def _touch(self, time: Time, body: dict[str, Any]) -> Entity | None:
        """Each finger if they are known, else the one contact: at the resultant of two fingers nothing touches."""
        fingers = body.get("contacts")
        touches = [body] if fingers is None and body["contact"] else fingers or []
        touches = [each for each in touches if each["x_m"] is not None and each["y_m"] is not None]
        if not touches:
            return None
        forces_known = body["force_n"] is not None and not body["over_range"]
        return Entity(
            timestamp=time,
            frame_id=self._pad,
            id="contact",
            cylinders=tuple(self._ellipse(each) for each in touches if None not in (each["x_sd_m"], each["y_sd_m"])),
            arrows=tuple(self._arrow(each) for each in touches) if forces_known else (),
            texts=() if fingers is None else tuple(self._number(each) for each in fingers),
        )

    def _place(self, touch: dict[str, Any]) -> Vector3:
        return Vector3(x=touch["x_m"], y=touch["y_m"], z=self._height_m)

    def _ellipse(self, touch: dict[str, Any]) -> Cylinder:
        across = [2 * ELLIPSE_DEVIATIONS * touch[key] for key in ("x_sd_m", "y_sd_m")]
        size = Vector3(x=across[0], y=across[1], z=1e-4)
        return Cylinder(pose=Pose(position=self._place(touch), orientation=Quaternion()), size=size, color=UNCERTAIN)

    def _number(self, finger: dict[str, Any]) -> Text:
        """The finger's id, below its place: above is the arrow."""
        place = Vector3(x=finger["x_m"], y=finger["y_m"], z=self._height_m / 2)
        return Text(pose=Pose(position=place), font_size=0.003, color=TOUCH, text=str(finger["id"]))

    def _arrow(self, touch: dict[str, Any]) -> Arrow:
        """The force; its head is where the finger touches. Shear that is not known is not drawn."""
        place = self._place(touch)
        force = [touch["shear_x_n"] or 0.0, touch["shear_y_n"] or 0.0, -touch["force_n"] or -1e-9]
        tail = [end - ARROW_M_PER_N * part for end, part in zip((place.x, place.y, place.z), force, strict=True)]
        length_m = ARROW_M_PER_N * sum(part * part for part in force) ** 0.5
        return Arrow(
            pose=Pose(position=vector(tail), orientation=turning(ALONG_X, force)),
            shaft_length=0.7 * length_m, shaft_diameter=1e-3, head_length=0.3 * length_m, head_diameter=2e-3,
            color=TOUCH,
        )  # fmt: skip

    def _health(self, time: Time, body: dict[str, Any]) -> Entity | None:
        words = body["health"]
        if words == "ok" and body["over_range"]:
            words = "pressed harder than its calibration knows"
        elif words == "ok" and body.get("more"):
            words = "two fingers do not explain the field"
        if words == "ok":
            return None
        text = Text(
            pose=Pose(position=Vector3(z=2 * self._height_m)), font_size=0.004, color=WARNING,
            text=f"{self._pad}: {words}" + (f": {body['reason']}" if body["reason"] else ""),
        )  # fmt: skip
        return Entity(timestamp=time, frame_id=self._pad, id="health", texts=(text,))


def _placed(pose: dict[str, Any]) -> Pose:
    """The pose of a magnet for Foxglove: z along its moment."""
    return Pose(position=vector(pose["position_m"]), orientation=turning(TOWARD_FINGER, pose["axis"]))
