"""Contacts as ROS 2 messages beside a recording's own, which Rerun, Foxglove and rosbag2 decode without a plug-in."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from fmfts.pad import Array
from fmfts_client.wrench import wrench_of
from fmfts_recording.foxglove import rotation_of
from fmfts_recording.scene import PLACED_S, WORLD

NAN = math.nan
NS_PER_S = 1_000_000_000
# As docs/messages.md explains them; unknown values are NaN.
NUMBERS = (
    *("x_m", "x_sd_m", "y_m", "y_sd_m", "force_n", "force_sd_n", "force_min_n"),
    *("shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n"),
)
CONTACT = "\n".join(
    (
        "# A pad's contact, in the pad's axes: origin in the plane of the sensors, z toward the finger.",
        "# What is not known is NaN. wrench: what the finger exerts on the pad, and its covariance, as rows of",
        "# fx fy fz tx ty tz.",
        "int8 UNKNOWN=-1",
        "int8 UNTOUCHED=0",
        "int8 TOUCHED=1",
        "std_msgs/Header header",
        "string health",
        "string reason",
        "int8 contact",
        "bool over_range",
        *(f"float64 {name}" for name in NUMBERS),
        "geometry_msgs/Wrench wrench",
        "float64[36] wrench_covariance",
    )
)
TIME = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec")
HEADER = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id")
VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")
WRENCH = ("geometry_msgs/Wrench", "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque")
QUATERNION = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w")
TRANSFORM = ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation")
STAMPED_TRANSFORM = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
)


def _with(text: str, *others: tuple[str, str]) -> str:
    """The text of a message and of those that it is made of, as MCAP's registry describes it for "ros2msg"."""
    return "\n".join((text, *(f"{'=' * 80}\nMSG: {name}\n{each}" for name, each in others)))


SCHEMAS = {
    "fmfts_msgs/msg/Contact": _with(CONTACT, HEADER, TIME, WRENCH, VECTOR),
    "geometry_msgs/msg/WrenchStamped": _with(
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench", HEADER, TIME, WRENCH, VECTOR
    ),
    "tf2_msgs/msg/TFMessage": _with(
        "geometry_msgs/TransformStamped[] transforms", STAMPED_TRANSFORM, HEADER, TIME, TRANSFORM, VECTOR, QUATERNION
    ),
}


@dataclass(frozen=True, slots=True)
class RosMessage:
    """`data`: in CDR. `schema`: a key of SCHEMAS."""

    topic: str
    schema: str
    data: bytes


class _Told(msgspec.Struct):
    """The part of a ContactMessage that is used here."""

    utc_ns: int
    t_sample_ns: int
    t_publish_ns: int
    health: str
    reason: str
    contact: bool | None
    over_range: bool
    x_m: float | None
    x_sd_m: float | None
    y_m: float | None
    y_sd_m: float | None
    force_n: float | None
    force_sd_n: float | None
    force_min_n: float | None
    shear_x_n: float | None
    shear_x_sd_n: float | None
    shear_y_n: float | None
    shear_y_sd_n: float | None


class RosPad:
    """facts: as `pads` of the control socket tells them."""

    def __init__(self, pad: str, facts: dict[str, Any]) -> None:
        self._pad, self._facts = pad, facts
        self._height_m = float(facts["rest_position_m"][2])
        self._placed_ns = 0

    def contact(self, body: dict[str, Any]) -> Iterator[RosMessage]:
        """A ContactMessage, at the time of its sample; now and then where the pad is."""
        told = msgspec.convert(body, _Told)
        stamp_ns = told.utc_ns - (told.t_publish_ns - told.t_sample_ns)
        if not 0 <= stamp_ns - self._placed_ns < PLACED_S * 1e9:
            self._placed_ns = stamp_ns
            yield RosMessage("tf", "tf2_msgs/msg/TFMessage", self._transform(stamp_ns))
        known = told.force_n is not None and not told.over_range
        wrench = wrench_of(told, self._height_m) if known else None
        six = (*wrench.force_n, *wrench.torque_nm) if wrench else (NAN,) * 6
        covariance = [part for row in wrench.covariance for part in row] if wrench else (NAN,) * 36
        message = _Cdr()
        message.header(stamp_ns, self._pad)
        message.text(told.health)
        message.text(told.reason)
        message.put("b", -1 if told.contact is None else int(told.contact))
        message.put("?", told.over_range)
        values = (getattr(told, name) for name in NUMBERS)
        message.doubles([*(NAN if value is None else value for value in values), *six, *covariance])
        yield RosMessage(f"ros/{self._pad}/contact", "fmfts_msgs/msg/Contact", message.data)
        if wrench:
            message = _Cdr()
            message.header(stamp_ns, self._pad)
            message.doubles(six)
            yield RosMessage(f"ros/{self._pad}/wrench", "geometry_msgs/msg/WrenchStamped", message.data)

    def _transform(self, stamp_ns: int) -> bytes:
        turn = rotation_of(self._facts["placement_rotation"])
        message = _Cdr()
        message.put("I", 1)
        message.header(stamp_ns, WORLD)
        message.text(self._pad)
        message.doubles([*self._facts["placement_m"], turn.x, turn.y, turn.z, turn.w])
        return message.data


class _Cdr:
    """Plain CDR, little-endian, as ROS 2 writes it: each number begins at a multiple of its size."""

    def __init__(self) -> None:
        self._body = bytearray()

    @property
    def data(self) -> bytes:
        return b"\x00\x01\x00\x00" + bytes(self._body)

    def put(self, kind: str, value: float) -> None:
        self._align(struct.calcsize(kind))
        self._body += struct.pack(f"<{kind}", value)

    def doubles(self, values: Sequence[float] | Array) -> None:
        self._align(8)
        self._body += np.asarray(values, dtype="<f8").tobytes()

    def text(self, value: str) -> None:
        encoded = value.encode() + b"\x00"
        self.put("I", len(encoded))
        self._body += encoded

    def header(self, stamp_ns: int, frame: str) -> None:
        self.put("i", stamp_ns // NS_PER_S)
        self.put("I", stamp_ns % NS_PER_S)
        self.text(frame)

    def _align(self, size: int) -> None:
        self._body += bytes(-len(self._body) % size)
