"""Watches the daemons of several robots: which are there, which are lost and since when, and how their pads are.

It costs a daemon next to nothing: of each pad the status, once a second, and a heartbeat of ZeroMQ ten times a second,
which ZeroMQ's own thread answers. Contacts are subscribed to only while somebody looks at a robot's own view.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import zmq
from zmq.utils.monitor import recv_monitor_message

from fmfts_client import EndpointError, Endpoints, MessageError, Status, Subscription
from fmfts_client.diagnosis import why_not_connected
from fmfts_fleet.pad_health import PadHealth, facts_of

HEARTBEAT_S = 0.1  # no answer for 2.5 of them means that the robot is lost: 0.35 s after its network was cut
SILENT_S = 2.5  # two statuses: the connection stands, but the daemon's loop does not run
FIRST_S = 2.0  # wait for the first status before a robot counts as unreachable
MOST_PADS = 256  # pads of one robot: further ones are dropped
TAKEN_AT_ONCE = 1000  # messages of one robot, and events of its connection, that are read at once

REFUSED = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL


class WatchedRobot:
    """One robot's daemon. state: "waiting", "there", "lost", or "unreached" if it has not been there yet.

    Raises EndpointError if its key cannot be used.
    """

    def __init__(self, name: str, endpoints: Endpoints, now_s: float) -> None:
        self.name = name
        self.state = "waiting"
        self._since_s = now_s
        self._endpoints = endpoints
        self._subscription = Subscription(("status",), None, endpoints, watch=True, heartbeat_s=HEARTBEAT_S)
        self._connected = False
        self._events = 0  # number of the newest attempt to connect
        self._heard_s = -math.inf
        self._boot = ""
        self._refusal = ""
        self._pads: dict[str, PadHealth] = {}

    def look(self, now_s: float) -> bool:
        """Take what has arrived; True if the robot's state is another one."""
        self._take_events()
        self._take_statuses(now_s)
        state = self._state(now_s)
        if state == self.state:
            return False
        self.state, self._since_s = state, now_s
        return True

    def facts(self, now_s: float) -> dict[str, Any]:
        """The page's facts; why: what is wrong and what to do, if the robot is not there."""
        is_there = self.state == "there"
        pads = list(self._pads.values())
        shown = facts_of(pads) if is_there else facts_of(()) | {"pads": len(pads)}
        return {
            "name": self.name,
            "address": self._endpoints.bus,
            "state": self.state,
            "since_s": round(now_s - self._since_s, 3),
            "why": self._why() if self.state in ("lost", "unreached") else "",
            **shown,
        }

    def close(self) -> None:
        self._subscription.close()

    def _take_events(self) -> None:
        monitor = self._subscription.monitor
        assert monitor is not None
        for _ in range(TAKEN_AT_ONCE):
            if not monitor.poll(0):
                return
            event = int(recv_monitor_message(monitor)["event"])
            if event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                self._connected, self._events = True, event
            elif event == zmq.EVENT_DISCONNECTED and self._connected:
                # It was let in before: this end says nothing about keys. Its last message describes the past.
                self._connected, self._events, self._heard_s = False, 0, -math.inf
            elif event == zmq.EVENT_CLOSED:  # nobody listens there
                self._events = 0
            elif event & (REFUSED | zmq.EVENT_DISCONNECTED):
                self._events |= event

    def _take_statuses(self, now_s: float) -> None:
        for _ in range(TAKEN_AT_ONCE):
            try:
                message = self._subscription.receive(0.0)
                if message is None:
                    return
                status = Status.from_message(message.body)
            except MessageError as error:  # a message of another version, or not a status
                self._refusal = str(error)
                continue
            if status.boot != self._boot:
                self._boot = status.boot
                self._pads.clear()
            if status.pad in self._pads or len(self._pads) < MOST_PADS:
                self._pads[status.pad] = PadHealth.of(status)
            self._heard_s, self._refusal = now_s, ""

    def _state(self, now_s: float) -> str:
        if self._connected and now_s - self._heard_s < SILENT_S:
            return "there"
        if self.state in ("there", "lost"):
            return "lost"
        return "unreached" if self.state == "unreached" or now_s - self._since_s >= FIRST_S else "waiting"

    def _why(self) -> str:
        if self._refusal:
            return self._refusal
        if self._connected:
            return (
                f"a program serves {self._endpoints.bus} and says nothing of any pad: is it fmfts-daemon, and what "
                "does its log say (`journalctl -u fmfts`)?"
            )
        if not self._events and self._endpoints.bus.startswith("tcp://"):  # the handshake ended before a key was shown
            return (
                f"no daemon at {self._endpoints.bus}: is the robot on and in the network, and is fmfts-daemon running "
                "on it (`systemctl status fmfts`)? It is there again by itself"
            )
        return why_not_connected(self._endpoints, self._events)


class Fleet:
    """All robots, by name. Raises EndpointError, with the robot's name, if a key cannot be used."""

    def __init__(self, robots: Mapping[str, Endpoints], now_s: float) -> None:
        self._robots: list[WatchedRobot] = []
        for name, endpoints in robots.items():
            try:
                self._robots.append(WatchedRobot(name, endpoints, now_s))
            except EndpointError as error:
                self.close()
                raise type(error)(f"robot '{name}': {error}") from error

    def look(self, now_s: float) -> bool:
        """Take what has arrived; True if a robot has come or gone."""
        changed = [robot.look(now_s) for robot in self._robots]
        return any(changed)

    def facts(self, now_s: float) -> dict[str, Any]:
        return {"fleet": [robot.facts(now_s) for robot in self._robots]}

    def close(self) -> None:
        for robot in self._robots:
            robot.close()
