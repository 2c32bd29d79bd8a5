"""The node: a thread receives the daemon's messages and publishes them; rclpy's executor serves requests.

Topics, services and parameters are in the README of this package.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from fmfts_client import (
    Contact,
    ControlError,
    EndpointError,
    JointPublisher,
    Message,
    MessageError,
    SchemaError,
    Status,
    Subscription,
    request,
)
from fmfts_client.silence import why_silent
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from fmfts_ros.messages import placed
from fmfts_ros.names import RosNames
from fmfts_ros.pads import RosPad

TURN_S = 0.1  # period of the checks for silence
DIAGNOSTICS_S = 1.0
PLACES_S = 1.0
BASELINE_PATIENCE_S = 10.0  # longest wait between two messages of progress, which come twice a second
SHEAR = {"nan": math.nan, "zero": 0.0}


class FmftsNode(Node):
    """Publishes all pads of one daemon. Waits for a daemon that is not there, and goes on after its restart.

    Raises EndpointError where the parameter `endpoint` or a key is wrong, ValueError for another wrong parameter.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("fmfts", **options)
        self._endpoint = self.declare_parameter("endpoint", "").value or None
        self._only = {pad for pad in self.declare_parameter("pads", [""]).value if pad}
        self._parent = self.declare_parameter("parent_frame", "fmfts").value
        self._prefix = self.declare_parameter("frame_prefix", "").value
        shear = self.declare_parameter("unknown_shear", "nan").value
        if shear not in SHEAR:
            raise ValueError(f"unknown_shear: {shear!r}: one of {', '.join(SHEAR)}")
        self._unknown_shear = SHEAR[shear]
        joints = self.declare_parameter("joint_states", "").value
        self._subscription = Subscription(("contact", "status"), None, self._endpoint)
        self._joints = JointPublisher(self._endpoint) if joints else None
        if joints:
            alone = MutuallyExclusiveCallbackGroup()
            self.create_subscription(JointState, joints, self._pass_joints, 10, callback_group=alone)
        self._names = RosNames()
        self._pads: dict[str, RosPad] = {}
        self._boots: frozenset[str] = frozenset()
        self._placed: frozenset[str] = frozenset()
        self._heights_m: dict[str, float] = {}
        self._fault = ""
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._transforms = self.create_publisher(TFMessage, "/tf_static", kept)
        # Requests to the daemon wait for its answer; one must not delay another.
        self._commands = MutuallyExclusiveCallbackGroup()
        self.create_timer(PLACES_S, self._place_pads, callback_group=MutuallyExclusiveCallbackGroup())
        self._stopping = threading.Event()
        self._receiver = threading.Thread(target=self._receive, name="fmfts-receiver")
        self._receiver.start()

    def destroy_node(self) -> None:
        """Stop receiving, then destroy publishers: nothing is published on a destroyed one."""
        self._stopping.set()
        self._receiver.join()
        self._subscription.close()
        if self._joints is not None:
            self._joints.close()
        super().destroy_node()

    def _pass_joints(self, state: JointState) -> None:
        """Pass a hand's joint positions on to the daemon, with the stamp on its clock."""
        known = {name: value for name, value in zip(state.name, state.position, strict=False) if math.isfinite(value)}
        if self._joints is None or not known:
            return
        now_ns, stamp_ns = (
            self.get_clock().now().nanoseconds,
            state.header.stamp.sec * 10**9 + state.header.stamp.nanosec,
        )
        age_ns = now_ns - stamp_ns if stamp_ns else 0
        self._joints.publish(known, time.monotonic_ns() - age_ns)

    def _receive(self) -> None:
        judged_s = diagnosed_s = 0.0
        while not self._stopping.is_set():
            changed = False
            try:
                message = self._subscription.receive(TURN_S)
                if message is not None and (not self._only or message.pad in self._only):
                    pad = self._pads.get(message.pad) or self._begin(message.pad)
                    self._take(pad, message)
                    self._fault = ""
                    changed = pad.has_new_verdict("")
            except SchemaError as error:
                self._fault = str(error)
            except MessageError as error:
                self._subscription.refuse(error)
            now_s = time.monotonic()
            if now_s - judged_s > TURN_S:
                judged_s = now_s
                for pad in self._pads.values():
                    changed |= pad.has_new_verdict(self._why_silent(pad))
            if changed or now_s - diagnosed_s > DIAGNOSTICS_S:
                diagnosed_s = now_s
                self._diagnose()

    def _take(self, pad: RosPad, message: Message) -> None:
        if message.kind == "status":
            pad.status = Status.from_message(message.body)
            return
        contact = Contact.from_message(message.body, message.clock_ahead_s)
        if contact.boot not in self._boots:
            self._boots = frozenset({contact.boot})  # the places of one daemon are read again after this time
        pad.height_m = self._heights_m.get(message.pad, pad.height_m)
        pad.take(contact)

    def _begin(self, pad: str) -> RosPad:
        name = self._names.of(pad)
        if name != pad:
            self.get_logger().warning(f"pad {pad!r} is {name!r} in ROS, which allows letters, digits and _ alone")
        found = self._pads[pad] = RosPad(self, pad, name, self._prefix + name, self._unknown_shear)
        for kind in ("rest", "bare"):
            self.create_service(
                Trigger,
                f"~/{name}/baseline_{kind}",
                lambda asked, answer, kind=kind: self._baseline(pad, kind, answer),
                callback_group=self._commands,
            )
        return found

    def _why_silent(self, pad: RosPad) -> str:
        if self._fault:
            return self._fault
        return why_silent(self._subscription.endpoints.bus) if pad.is_silent else ""

    def _diagnose(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        message.status = [pad.diagnosis(self._why_silent(pad)) for pad in self._pads.values()]
        if not self._pads:
            sentence = self._fault or f"nothing has arrived: {why_silent(self._subscription.endpoints.bus)}"
            message.status = [DiagnosticStatus(level=DiagnosticStatus.ERROR, name="fmfts", message=sentence)]
        self._diagnostics.publish(message)

    def _place_pads(self) -> None:
        """Asks a daemon that is new where its pads lie, and publishes that once: it stays until the next one."""
        boots = self._boots
        if boots == self._placed:
            return
        try:
            pads = request("pads", endpoint=self._endpoint, timeout_s=PLACES_S)["pads"]
        except (ControlError, EndpointError) as error:
            self.get_logger().warning(f"where the pads lie is not known yet: {error}", throttle_duration_sec=10.0)
            return
        wanted = [pad for pad in pads if not self._only or pad["pad"] in self._only]
        self._heights_m = {pad["pad"]: pad["rest_position_m"][2] for pad in wanted}
        transforms = [
            placed(
                self._prefix + self._names.of(pad["pad"]),
                self._parent,
                pad["placement_m"],
                pad["placement_rotation"],
            )
            for pad in wanted
        ]
        now = self.get_clock().now().to_msg()
        for transform in transforms:
            transform.header.stamp = now
        self._transforms.publish(TFMessage(transforms=transforms))
        self._placed = boots

    def _baseline(self, pad: str, kind: str, answer: Trigger.Response) -> Trigger.Response:
        """Records a baseline, three seconds long: nothing may touch the pad meanwhile ("bare": it is not mounted)."""
        bare = {"bare": True} if kind == "bare" else {}
        try:
            facts = request("baseline", endpoint=self._endpoint, timeout_s=BASELINE_PATIENCE_S, pad=pad, **bare)
        except (ControlError, EndpointError) as error:
            answer.success, answer.message = False, str(error)
        else:
            answer.success, answer.message = True, f"baseline {facts.get('baseline')} ({facts.get('kind')})"
        return answer
