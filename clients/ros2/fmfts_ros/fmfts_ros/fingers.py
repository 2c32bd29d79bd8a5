"""The fingers on a pad with several magnets, as a point cloud: the standard type for a list of places with numbers."""

from __future__ import annotations

import math
import sys
from array import array

from fmfts_client import Contact, Finger
from sensor_msgs.msg import PointCloud2, PointField

from fmfts_ros.messages import has_force, sample_time

# Every reader of point clouds looks for x, y and z; docs/messages.md explains the other fields.
NUMBERS = ("x_sd_m", "y_sd_m", "force_n", "force_sd_n", "shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n")
COLUMNS = ("x", "y", "z", "id", *NUMBERS)
COLUMN_BYTES = 4
POINT_BYTES = COLUMN_BYTES * len(COLUMNS)
IDS = 1 << 32  # a PointField has no integer of 64 bits


def finger_cloud(contact: Contact, frame: str, height_m: float) -> PointCloud2 | None:
    """One point a finger, and no point without contact. None where fingers are not known: `has_fingers`.

    height_m: height above the sensors at which the forces act; nothing is known before it is.
    """
    if not has_fingers(contact) or contact.contacts is None or math.isnan(height_m):
        return None
    message = PointCloud2()
    message.header.stamp, message.header.frame_id = sample_time(contact), frame
    message.fields = [
        PointField(name=name, offset=COLUMN_BYTES * column, datatype=_type_of(name), count=1)
        for column, name in enumerate(COLUMNS)
    ]
    message.height, message.width = 1, len(contact.contacts)
    message.point_step, message.row_step = POINT_BYTES, POINT_BYTES * len(contact.contacts)
    message.is_bigendian, message.is_dense = sys.byteorder == "big", True
    # rclpy accepts this kind of array as it is, and checks each byte of any other.
    message.data = array("B", b"".join(_packed(finger, height_m) for finger in contact.contacts))
    return message


def has_fingers(contact: Contact) -> bool:
    """Are `contacts` all the touches? Where two fingers do not explain the field, they are wrong."""
    return has_force(contact) and contact.contacts is not None and contact.more is False


def _type_of(name: str) -> int:
    return PointField.UINT32 if name == "id" else PointField.FLOAT32


def _packed(finger: Finger, height_m: float) -> bytes:
    numbers = (math.nan if value is None else value for value in (getattr(finger, name) for name in NUMBERS))
    place = array("f", (finger.x_m, finger.y_m, height_m))
    return b"".join(part.tobytes() for part in (place, array("I", [finger.id % IDS]), array("f", numbers)))
