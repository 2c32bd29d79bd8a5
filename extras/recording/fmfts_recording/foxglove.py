"""The schemas of Foxglove that a recording uses, and the shapes in them (docs.foxglove.dev, "Message schemas").

Lengths are in metres. Field names, types and meanings are Foxglove's; a test holds them to its SDK.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

NS_PER_S = 1_000_000_000


class Time(msgspec.Struct, frozen=True, kw_only=True):
    sec: int
    nsec: int


class Vector3(msgspec.Struct, frozen=True, kw_only=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(msgspec.Struct, frozen=True, kw_only=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(msgspec.Struct, frozen=True, kw_only=True):
    position: Vector3 = Vector3()
    orientation: Quaternion = Quaternion()


class Color(msgspec.Struct, frozen=True, kw_only=True):
    r: float
    g: float
    b: float
    a: float = 1.0


class Arrow(msgspec.Struct, frozen=True, kw_only=True):
    pose: Pose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: Color


class Box(msgspec.Struct, frozen=True, kw_only=True):
    """A cube, or a sphere, with its diameter along each axis."""

    pose: Pose
    size: Vector3
    color: Color


class Cylinder(msgspec.Struct, frozen=True, kw_only=True):
    pose: Pose
    size: Vector3
    bottom_scale: float = 1.0
    top_scale: float = 1.0
    color: Color


class Text(msgspec.Struct, frozen=True, kw_only=True):
    pose: Pose
    billboard: bool = True
    font_size: float
    scale_invariant: bool = False
    color: Color
    text: str


class Entity(msgspec.Struct, frozen=True, kw_only=True):
    """Replaces the entity of the same id; a lifetime of zero: until it is replaced or deleted."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time = Time(sec=0, nsec=0)
    frame_locked: bool = True
    metadata: tuple[str, ...] = ()
    arrows: tuple[Arrow, ...] = ()
    cubes: tuple[Box, ...] = ()
    spheres: tuple[Box, ...] = ()
    cylinders: tuple[Cylinder, ...] = ()
    lines: tuple[str, ...] = ()
    triangles: tuple[str, ...] = ()
    texts: tuple[Text, ...] = ()
    models: tuple[str, ...] = ()


class Deletion(msgspec.Struct, frozen=True, kw_only=True):
    """Deletes the entity of this id (type 0)."""

    timestamp: Time
    type: int = 0
    id: str


class SceneUpdate(msgspec.Struct, frozen=True, kw_only=True):
    deletions: tuple[Deletion, ...] = ()
    entities: tuple[Entity, ...] = ()


class PoseInFrame(msgspec.Struct, frozen=True, kw_only=True):
    timestamp: Time
    frame_id: str
    pose: Pose


class PosesInFrame(msgspec.Struct, frozen=True, kw_only=True):
    timestamp: Time
    frame_id: str
    poses: tuple[Pose, ...]


class FrameTransform(msgspec.Struct, frozen=True, kw_only=True):
    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


def time_of(utc_ns: int) -> Time:
    return Time(sec=utc_ns // NS_PER_S, nsec=utc_ns % NS_PER_S)


def vector(parts: Sequence[float]) -> Vector3:
    x, y, z = map(float, parts)
    return Vector3(x=x, y=y, z=z)


def turning(start: Sequence[float], end: Sequence[float]) -> Quaternion:
    """The shortest rotation that turns `start`, one of the axes, into the direction of `end`."""
    length = math.sqrt(sum(part * part for part in end))
    end = [part / length for part in end]
    x, y, z = (
        start[1] * end[2] - start[2] * end[1],
        start[2] * end[0] - start[0] * end[2],
        start[0] * end[1] - start[1] * end[0],
    )
    w = 1.0 + sum(one * other for one, other in zip(start, end, strict=True))
    size = math.sqrt(x * x + y * y + z * z + w * w)
    if size < 1e-9:  # opposite: half a turn about any axis at a right angle
        return Quaternion(x=start[2], y=start[0], z=start[1], w=0.0)
    return Quaternion(x=x / size, y=y / size, z=z / size, w=w / size)


def rotation_of(matrix: Sequence[Sequence[float]]) -> Quaternion:
    """From a matrix (3, 3). The column of 4qqᵀ with the largest diagonal has no cancellation (Shepperd 1978)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    columns = [
        (1 + xx - yy - zz, xy + yx, xz + zx, zy - yz),
        (xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx),
        (xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy),
        (zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz),
    ]
    largest = max(range(4), key=lambda index: columns[index][index])
    size = math.sqrt(sum(part * part for part in columns[largest]))
    x, y, z, w = (part / size for part in columns[largest])
    return Quaternion(x=x, y=y, z=z, w=w)
