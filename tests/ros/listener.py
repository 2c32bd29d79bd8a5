"""A second process of ROS: receives what the node publishes, and prints each message as a line of JSON.

Runs in the environment of a distribution. Ends with its standard input; `?` there asks for the graph, `call NAME` calls
a service.
"""

from __future__ import annotations

import json
import struct
import sys
import threading
import time
from contextlib import suppress
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

SENSOR_DATA = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
TYPES = {
    "geometry_msgs/msg/WrenchStamped": (WrenchStamped, SENSOR_DATA),
    "geometry_msgs/msg/PointStamped": (PointStamped, SENSOR_DATA),
    "sensor_msgs/msg/PointCloud2": (PointCloud2, SENSOR_DATA),
    "diagnostic_msgs/msg/DiagnosticArray": (DiagnosticArray, QoSProfile(depth=100)),
    "tf2_msgs/msg/TFMessage": (TFMessage, QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)),
}
LOOK_S = 0.2


def say(**facts: Any) -> None:
    print(json.dumps(facts | {"received_s": time.monotonic()}), flush=True)


def stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def shown(message: Any) -> dict[str, Any]:
    if isinstance(message, WrenchStamped):
        force, torque = message.wrench.force, message.wrench.torque
        return {"force": [force.x, force.y, force.z], "torque": [torque.x, torque.y, torque.z]}
    if isinstance(message, PointStamped):
        return {"point": [message.point.x, message.point.y, message.point.z]}
    if isinstance(message, PointCloud2):
        kinds = {PointField.FLOAT32: "f", PointField.UINT32: "I"}
        form = "<" + "".join(kinds[each.datatype] for each in message.fields)
        names = [each.name for each in message.fields]
        points = [dict(zip(names, values, strict=True)) for values in struct.iter_unpack(form, bytes(message.data))]
        return {"points": points, "width": message.width, "point_step": message.point_step}
    if isinstance(message, DiagnosticArray):
        statuses = [
            {"name": each.name, "level": ord(each.level), "message": each.message, "hardware_id": each.hardware_id,
             "values": {value.key: value.value for value in each.values}}
            for each in message.status
        ]  # fmt: skip
        return {"statuses": statuses}
    transforms = [
        {"parent": each.header.frame_id, "child": each.child_frame_id,
         "position": [getattr(each.transform.translation, axis) for axis in "xyz"],
         "rotation": [getattr(each.transform.rotation, axis) for axis in "xyzw"]}
        for each in message.transforms
    ]  # fmt: skip
    return {"transforms": transforms}


class Listener(Node):
    def __init__(self) -> None:
        super().__init__("listener")
        self._topics: set[str] = set()
        self.create_timer(LOOK_S, self.subscribe_to_new)

    def subscribe_to_new(self) -> None:
        for topic, kinds in self.get_topic_names_and_types():
            if topic not in self._topics and kinds[0] in TYPES:
                self._topics.add(topic)
                kind, quality = TYPES[kinds[0]]
                self.create_subscription(kind, topic, lambda message, topic=topic: self.hear(topic, message), quality)

    def hear(self, topic: str, message: Any) -> None:
        header = getattr(message, "header", None)
        stamped = {} if header is None else {"stamp_ns": stamp_ns(header), "frame": header.frame_id}
        say(topic=topic, **stamped, **shown(message))

    def graph(self) -> dict[str, Any]:
        published = {}
        for topic in sorted(self._topics):
            for each in self.get_publishers_info_by_topic(topic):
                published[topic] = {"type": each.topic_type, "hash": str(each.topic_type_hash),
                                    "reliability": each.qos_profile.reliability.name}  # fmt: skip
        return {"nodes": self.get_node_names_and_namespaces(), "topics": published,
                "services": dict(self.get_service_names_and_types())}  # fmt: skip

    def call(self, name: str) -> None:
        client = self.create_client(Trigger, name)
        if not client.wait_for_service(5.0):
            say(answer="nobody serves it")
            return
        client.call_async(Trigger.Request()).add_done_callback(
            lambda answered: say(success=answered.result().success, answer=answered.result().message)
        )


def main() -> None:
    rclpy.init()
    listener = Listener()
    executor = SingleThreadedExecutor()
    executor.add_node(listener)

    def spin() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    spinning = threading.Thread(target=spin)
    spinning.start()
    for line in sys.stdin:
        if line.strip() == "?":
            say(graph=listener.graph())
        elif line.startswith("call "):
            listener.call(line.split()[1])
    rclpy.shutdown()
    spinning.join()


if __name__ == "__main__":
    main()
