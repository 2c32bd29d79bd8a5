"""`ros2 run fmfts_ros fmfts`: runs the node until SIGINT or SIGTERM."""

from __future__ import annotations

import sys

import rclpy
from fmfts_client import EndpointError
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor

from fmfts_ros.node import FmftsNode


def main() -> int:
    rclpy.init()
    try:
        node = FmftsNode()
    except (EndpointError, ValueError) as error:
        print(f"fmfts: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        return 1
    executor = MultiThreadedExecutor(2)  # wait for a request to the daemon, and the timer's period
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
