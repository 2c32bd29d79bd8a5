"""Publishes joint states of two joints, at 50 Hz, until it is ended. Runs in the environment of a distribution."""

from __future__ import annotations

import math
import time

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState


def main() -> None:
    rclpy.init()
    node = Node("hand")
    publisher = node.create_publisher(JointState, "/joint_states", 10)
    begun_s = time.monotonic()
    while True:
        time.sleep(0.02)
        message = JointState()
        message.header.stamp = node.get_clock().now().to_msg()
        message.name, message.position = ["knuckle", "middle"], [math.sin(time.monotonic() - begun_s), 0.5]
        publisher.publish(message)


main()
