"""Makes ROS messages of a contact. What is not known is NaN, or no message; it is never zero."""

from __future__ import annotations

import math
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from fmfts_client import Contact
from fmfts_client.wrench import wrench_of
from geometry_msgs.msg import PointStamped, TransformStamped, WrenchStamped

NS_PER_S = 1_000_000_000
NAN = math.nan


def sample_time(contact: Contact) -> Time:
    """When the newest sample of the contact was taken, since 1970 as ROS time counts.

    `utc_ns` is the date of publishing, and both other times are of one clock.
    """
    taken_ns = contact.utc_ns - (contact.t_publish_ns - contact.t_sample_ns)
    return Time(sec=taken_ns // NS_PER_S, nanosec=taken_ns % NS_PER_S)


def has_force(contact: Contact) -> bool:
    """Is the force a measurement? Beyond the calibrated range it is a guess, and only a lower bound is known."""
    return contact.force_n is not None and not contact.over_range


def wrench(contact: Contact, frame: str, height_m: float, unknown_shear: float = NAN) -> WrenchStamped:
    """The force that the touching object exerts on the pad, in newton, and its torque about the frame's origin, in Nm.

    A finger that presses pushes along −z, because z points toward it. height_m: where above the sensors the force acts.
    unknown_shear: stands for shear, and for the torque of it, where the contact model tells none. An untouched pad has
    neither shear nor torque. The torque leaves out a twist of the finger about z, which the pad does not measure.
    """
    told = wrench_of(contact, height_m, unknown_shear)
    message = WrenchStamped()
    message.header.stamp, message.header.frame_id = sample_time(contact), frame
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z = told.force_n
    torque.x, torque.y, torque.z = told.torque_nm
    return message


def contact_point(contact: Contact, frame: str, height_m: float) -> PointStamped | None:
    """The place of the touch; None without a touch, or if the place is unknown. height_m: as of `wrench`."""
    if not contact.contact or contact.x_m is None or contact.y_m is None or math.isnan(height_m):
        return None
    message = PointStamped()
    message.header.stamp, message.header.frame_id = sample_time(contact), frame
    message.point.x, message.point.y, message.point.z = contact.x_m, contact.y_m, height_m
    return message


def placed(
    frame: str, parent: str, position_m: Sequence[float], rotation: Sequence[Sequence[float]]
) -> TransformStamped:
    """The transform of [pad.placement]. rotation: a matrix (3, 3), from the pad's axes to the parent's."""
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, frame
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = map(float, position_m)
    turn.x, turn.y, turn.z, turn.w = quaternion(rotation)
    return message


def quaternion(rotation: Sequence[Sequence[float]]) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation matrix (3, 3).

    4 qq^T has these diagonal elements; the column of the largest has no cancellation (Shepperd 1978).
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    columns = [
        (1 + xx - yy - zz, xy + yx, xz + zx, zy - yz),
        (xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx),
        (xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy),
        (zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz),
    ]
    largest = max(range(4), key=lambda index: columns[index][index])
    length = math.sqrt(sum(part * part for part in columns[largest]))
    x, y, z, w = (part / length for part in columns[largest])
    return x, y, z, w
