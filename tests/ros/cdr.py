"""Each type that the node publishes: rclpy and rosbags must write the same bytes, and read each other's.

Runs in the environment of a distribution: `python cdr.py jazzy`. ROS does not initialise bytes of padding; a byte is
padding if rosbags reads the same message whatever its value.
"""

from __future__ import annotations

import sys
from array import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped, Quaternion, Transform, TransformStamped, Vector3, Wrench, WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

HEADER = Header(stamp=Time(sec=1_800_000_000, nanosec=123_456_789), frame_id="left_finger")
POINT = PointStamped(header=HEADER)
POINT.point.x, POINT.point.y, POINT.point.z = 1.5e-3, -2e-3, 12e-3
FORCE, TORQUE = Vector3(x=0.25, y=float("inf"), z=-1.5), Vector3(x=1e-3, y=-1e-3, z=0.0)
TURN = Transform(translation=Vector3(x=0.01, y=0.02, z=0.03), rotation=Quaternion(x=0.5, y=-0.5, z=0.5, w=0.5))
STATUS = DiagnosticStatus(
    level=DiagnosticStatus.ERROR, name="fmfts: left", message="disconnected: no port", hardware_id="686f",
    values=[KeyValue(key="rate_hz", value="0"), KeyValue(key="reason", value="µT")],
)  # fmt: skip
FIELDS = [
    PointField(name="x", offset=0, datatype=PointField.FLOAT32, count=1),
    PointField(name="id", offset=4, datatype=PointField.UINT32, count=1),
]
CLOUD = PointCloud2(header=HEADER, height=1, width=2, fields=FIELDS, point_step=8, row_step=16, is_dense=True)
CLOUD.data = array("B", range(16))
EXAMPLES = {
    "geometry_msgs/msg/WrenchStamped": WrenchStamped(header=HEADER, wrench=Wrench(force=FORCE, torque=TORQUE)),
    "geometry_msgs/msg/PointStamped": POINT,
    "sensor_msgs/msg/PointCloud2": CLOUD,
    "diagnostic_msgs/msg/DiagnosticArray": DiagnosticArray(header=HEADER, status=[STATUS, DiagnosticStatus()]),
    "tf2_msgs/msg/TFMessage": TFMessage(
        transforms=[TransformStamped(header=HEADER, child_frame_id="left", transform=TURN)]
    ),
}


def same(one: Any, other: Any) -> bool:
    return repr(one) == repr(other)


def padding(store: Any, name: str, data: bytes) -> set[int]:
    plain, found = store.deserialize_cdr(data, name), set()
    for position in range(4, len(data)):
        changed = bytearray(data)
        changed[position] ^= 0xFF
        try:
            if same(store.deserialize_cdr(bytes(changed), name), plain):
                found.add(position)
        except Exception:  # noqa: BLE001 - an impossible length or text: this byte counts
            continue
    return found


def main() -> None:
    store = get_typestore(Stores[f"ROS2_{sys.argv[1].upper()}"])
    for name, message in EXAMPLES.items():
        ours = serialize_message(message)
        theirs = bytes(store.serialize_cdr(store.deserialize_cdr(ours, name), name))
        unused = padding(store, name, theirs)
        assert len(ours) == len(theirs), name
        differ = [at for at in range(len(ours)) if ours[at] != theirs[at] and at not in unused]
        assert not differ, f"{name}: bytes {differ} differ"
        assert deserialize_message(theirs, type(message)) == message, name
        assert len(unused) < len(ours) // 4, f"{name}: nearly all of it is called padding"
        print(name, len(ours), "bytes,", len(unused), "of padding")
    assert np.isinf(store.deserialize_cdr(serialize_message(EXAMPLES["geometry_msgs/msg/WrenchStamped"]),
                                          "geometry_msgs/msg/WrenchStamped").wrench.force.y)  # fmt: skip


if __name__ == "__main__":
    main()
