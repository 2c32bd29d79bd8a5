"""One pad in ROS: its publishers, and the daemon's last facts about it."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticStatus
from fmfts_client import ALIVE_S, Contact, Status
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from fmfts_ros.diagnosis import status_of, verdict
from fmfts_ros.fingers import finger_cloud
from fmfts_ros.messages import contact_point, has_force, wrench
from fmfts_ros.touches import kinds, slip_message

# Sensor data: nothing is sent twice. The history covers 0.2 s without processor time for the other side.
SENSOR_DATA = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


class RosPad:
    """Publishes each new contact of one pad. Only the thread that receives contacts may use it.

    name: legal in ROS. height_m: where above the sensors the contact acts; NaN until the daemon has told it.
    """

    def __init__(self, node: Node, pad: str, name: str, frame: str, unknown_shear: float) -> None:
        self.pad, self.name, self.frame = pad, name, frame
        self.height_m = float("nan")
        self.contact: Contact | None = None
        self.status: Status | None = None
        self._node = node
        self._unknown_shear = unknown_shear
        self._heard_s = time.monotonic()
        self._sample_ns = 0
        self._verdict = (b"", "")
        self._wrench = node.create_publisher(WrenchStamped, f"~/{name}/wrench", SENSOR_DATA)
        self._point = node.create_publisher(PointStamped, f"~/{name}/contact_point", SENSOR_DATA)
        self._touches = [
            (node.create_publisher(kind, f"~/{name}/{end}", SENSOR_DATA), maker)
            for end, (kind, maker) in kinds().items()
        ]
        self._fingers: Publisher | None = None  # a pad with one magnet has no such topic
        self._slip: Publisher | None = None  # None, too, if the configuration does not ask for it

    @property
    def silence_s(self) -> float:
        """The time since the daemon sent something of this pad."""
        return time.monotonic() - self._heard_s

    @property
    def is_silent(self) -> bool:
        return self.silence_s > ALIVE_S

    def take(self, contact: Contact) -> None:
        """Publish force, place and fingers of a contact that is new and not old, where it has them.

        While its source is silent, the daemon repeats a contact with the time of the last sample.
        """
        self.contact, self._heard_s = contact, time.monotonic()
        is_new = contact.t_sample_ns != self._sample_ns and contact.sample_age_s < ALIVE_S
        self._sample_ns = contact.t_sample_ns
        if not is_new or not has_force(contact):
            return
        self._wrench.publish(wrench(contact, self.frame, self.height_m, self._unknown_shear))
        point = contact_point(contact, self.frame, self.height_m)
        if point is not None:
            self._point.publish(point)
        for publisher, maker in self._touches:
            publisher.publish(maker(contact, self.frame, self.height_m))
        if contact.tells_fingers:
            self._publish_fingers(contact)
        slip = slip_message(contact, self.frame)
        if slip is not None:
            self._slip = self._slip or self._node.create_publisher(type(slip), f"~/{self.name}/slip", SENSOR_DATA)
            self._slip.publish(slip)

    def _publish_fingers(self, contact: Contact) -> None:
        if self._fingers is None:
            self._fingers = self._node.create_publisher(PointCloud2, f"~/{self.name}/contacts", SENSOR_DATA)
        cloud = finger_cloud(contact, self.frame, self.height_m)
        if cloud is not None:
            self._fingers.publish(cloud)

    def has_new_verdict(self, why_silent: str) -> bool:
        """Has level or health changed since the last call? Numbers in sentences do not count."""
        level, _ = verdict(self.contact, self.silence_s, why_silent)
        judged = level, "" if self.contact is None or why_silent else self.contact.health
        changed = judged != self._verdict
        self._verdict = judged
        return changed

    def diagnosis(self, why_silent: str) -> DiagnosticStatus:
        return status_of(f"fmfts: {self.pad}", self.contact, self.status, self.silence_s, why_silent)
