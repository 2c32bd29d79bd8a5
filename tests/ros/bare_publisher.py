"""What ROS alone costs: publishes as much as a touched pad and an untouched one, and prints its processor time.

Runs in the environment of a distribution.
"""

from __future__ import annotations

import json
import time

import rclpy
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

RATE_HZ = 220
SECONDS = 4.0


def main() -> None:
    rclpy.init()
    node = Node("bare")
    topics = {
        "/bare/one/wrench": WrenchStamped,
        "/bare/one/contact_point": PointStamped,
        "/bare/two/wrench": WrenchStamped,
    }
    publishers = [(kind, node.create_publisher(kind, topic, qos_profile_sensor_data)) for topic, kind in topics.items()]
    time.sleep(1.0)  # the listener has found the topics
    begun_s, used_s = time.monotonic(), time.process_time()
    for turn in range(int(SECONDS * RATE_HZ)):
        time.sleep(max(0.0, begun_s + turn / RATE_HZ - time.monotonic()))
        for kind, publisher in publishers:
            message = kind()
            message.header.stamp, message.header.frame_id = node.get_clock().now().to_msg(), "bare"
            publisher.publish(message)
    ended_s = time.monotonic()
    share = (time.process_time() - used_s) / (ended_s - begun_s)
    print(json.dumps({"of_a_core": share, "received_s": ended_s}), flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
