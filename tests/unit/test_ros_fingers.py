"""What the ROS 2 node makes of fingers, with stand-ins for ROS's types; `make ros` has the real ones."""

from __future__ import annotations

import importlib
import math
import sys
import time
from array import array
from collections.abc import Iterator
from dataclasses import field, make_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import msgpack
import numpy as np
import pytest
from bus_messages import contact_message, finger_message, fingers_message, two_fingers

from fmfts.bus.encoding import encode
from fmfts.bus.messages import ContactMessage
from fmfts_client import Contact

PACKAGE = Path(__file__).parents[2] / "clients/ros2/fmfts_ros"
HEIGHT_M = 0.0105


def message(name: str, /, **defaults: Any) -> type:
    """A type of ROS: each object has parts of its own, and no other fields than these."""
    fields = [
        (key, Any, field(default_factory=value if isinstance(value, type) else lambda value=value: value))
        for key, value in defaults.items()
    ]
    return make_dataclass(name, fields, slots=True)


# Fields as in ROS's common_interfaces.
Time = message("Time", sec=0, nanosec=0)
Header = message("Header", stamp=Time, frame_id="")
Vector3 = message("Vector3", x=0.0, y=0.0, z=0.0)
Quaternion = message("Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
Wrench = message("Wrench", force=Vector3, torque=Vector3)
Transform = message("Transform", translation=Vector3, rotation=Quaternion)
PointField = message("PointField", name="", offset=0, datatype=0, count=0)
PointField.UINT32, PointField.FLOAT32 = 6, 7  # type: ignore[attr-defined]
DiagnosticStatus = message("DiagnosticStatus", level=b"\0", name="", message="", hardware_id="", values=list)
DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR = b"\0", b"\1", b"\2"  # type: ignore[attr-defined]
TYPES: dict[str, dict[str, Any]] = {
    "builtin_interfaces.msg": {"Time": Time},
    "geometry_msgs.msg": {
        "PointStamped": message("PointStamped", header=Header, point=Vector3),
        "TransformStamped": message("TransformStamped", header=Header, child_frame_id="", transform=Transform),
        "WrenchStamped": message("WrenchStamped", header=Header, wrench=Wrench),
    },
    "sensor_msgs.msg": {
        "PointField": PointField,
        "PointCloud2": message(
            "PointCloud2", header=Header, height=0, width=0, fields=list, is_bigendian=False, point_step=0, row_step=0,
            data=list, is_dense=False,
        ),
    },
    "diagnostic_msgs.msg": {
        "DiagnosticStatus": DiagnosticStatus,
        "KeyValue": message("KeyValue", key="", value=""),
    },
    "rclpy.node": {"Node": object},
    "rclpy.publisher": {"Publisher": object},
    "rclpy.qos": {
        "QoSProfile": lambda **options: options,
        "ReliabilityPolicy": type("ReliabilityPolicy", (), {"BEST_EFFORT": 2}),
    },
}  # fmt: skip


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Imports a module of the package. The package leaves no trace."""
    for name, contents in TYPES.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name.partition(".")[0], ModuleType(name.partition(".")[0]))
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(PACKAGE)
    yield lambda name: importlib.import_module(f"fmfts_ros.{name}")
    for name in [name for name in sys.modules if name.partition(".")[0] == "fmfts_ros"]:
        del sys.modules[name]


class FakeNode:
    """Keeps what is published, by topic."""

    def __init__(self) -> None:
        self.published: dict[str, list[Any]] = {}

    def create_publisher(self, kind: type, topic: str, quality: object) -> Any:
        messages = self.published[topic] = []

        class Publisher:
            def publish(self, message: Any) -> None:
                assert type(message) is kind
                messages.append(message)

        return Publisher()


def received(message: ContactMessage) -> Contact:
    return Contact.from_message(msgpack.unpackb(encode(message)))


def points(cloud: Any) -> list[dict[str, float]]:
    """The points as a reader of point clouds unpacks them, by the fields in the message itself."""
    kinds = {PointField.FLOAT32: "<f4", PointField.UINT32: "<u4"}  # type: ignore[attr-defined]
    layout = np.dtype(
        {
            "names": [each.name for each in cloud.fields],
            "formats": [kinds[each.datatype] for each in cloud.fields],
            "offsets": [each.offset for each in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    assert cloud.row_step == cloud.width * cloud.point_step == len(cloud.data)
    assert isinstance(cloud.data, array)
    assert cloud.data.typecode == "B"
    unpacked = np.frombuffer(cloud.data.tobytes(), layout)
    return [{name: float(row[name]) for name in layout.names or ()} for row in unpacked]


def test_each_finger_is_a_point_with_its_numbers(ros: Any) -> None:
    contact = received(fingers_message(*two_fingers()))
    cloud = ros("fingers").finger_cloud(contact, "left", HEIGHT_M)
    assert cloud.header.frame_id == "left"
    taken_ns = contact.utc_ns - (contact.t_publish_ns - contact.t_sample_ns)
    assert cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec == taken_ns
    one, two = points(cloud)
    assert (one["id"], two["id"]) == (3, 4)
    assert [one[axis] for axis in "xyz"] == pytest.approx([-0.004, 0.002, HEIGHT_M])
    assert (one["force_n"], two["force_n"]) == pytest.approx((0.6, 0.9))
    assert (one["x_sd_m"], one["y_sd_m"], one["force_sd_n"]) == pytest.approx((0.0003, 0.0004, 0.04))
    assert (two["shear_x_n"], two["shear_x_sd_n"], two["shear_y_n"], two["shear_y_sd_n"]) == pytest.approx(
        (0.1, 0.02, 0.0, 0.03)
    )
    assert all(math.isnan(one[name]) for name in ("shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n"))


def test_no_contact_is_an_empty_cloud_and_unknown_is_null(ros: Any) -> None:
    cloud = ros("fingers").finger_cloud
    assert points(cloud(received(fingers_message()), "left", HEIGHT_M)) == []
    unknown = {
        "cannot tell": received(fingers_message(contacts=None)),
        "more than two": received(fingers_message(*two_fingers(), more=True)),
        "over range": received(fingers_message(*two_fingers(), over_range=True)),
        "one magnet": received(contact_message()),
    }
    assert {why: cloud(contact, "left", HEIGHT_M) for why, contact in unknown.items()} == dict.fromkeys(unknown)
    assert cloud(received(fingers_message()), "left", math.nan) is None, "the height is not known yet"


def test_unrepresentable_numbers_do_not_stop_the_plot(ros: Any) -> None:
    contact = received(fingers_message(finger_message(2**40 + 5, force_sd_n=1e300)))
    (point,) = points(ros("fingers").finger_cloud(contact, "left", HEIGHT_M))
    assert (point["id"], point["force_sd_n"]) == (5, math.inf)


def test_pad_has_the_topic_of_fingers_once_it_reports_them(ros: Any) -> None:
    node = FakeNode()
    pad = ros("pads").RosPad(node, "left", "left", "left", 0.0)
    pad.height_m = HEIGHT_M
    pad.take(received(contact_message()))
    assert set(node.published) == {"~/left/wrench", "~/left/contact_point"}
    now_ns = time.monotonic_ns()
    for number, contacts in enumerate((list(two_fingers()), None, [])):
        times = {"t_sample_ns": now_ns + number, "t_publish_ns": now_ns + number}
        pad.take(received(fingers_message(*two_fingers(), contacts=contacts, **times)))
    assert [cloud.width for cloud in node.published["~/left/contacts"]] == [2, 0]
    assert len(node.published["~/left/wrench"]) == 4, "the resultant goes on as ever"


def test_diagnostics_count_fingers_and_warn_of_more(ros: Any) -> None:
    diagnosis = ros("diagnosis")

    def told(message: ContactMessage) -> tuple[Any, dict[str, str]]:
        status = diagnosis.status_of("fmfts: left", received(message), None, 0.0, "")
        return status, {each.key: each.value for each in status.values}

    status, values = told(fingers_message(*two_fingers()))
    assert (status.level, values["fingers"], values["more"]) == (b"\0", "2", "False")
    status, values = told(fingers_message(*two_fingers(), more=True))
    assert (status.level, values["more"]) == (b"\1", "True")
    assert "two fingers do not explain" in status.message
    assert told(fingers_message(contacts=None))[1]["fingers"] == "unknown"
    assert "fingers" not in told(contact_message())[1]
