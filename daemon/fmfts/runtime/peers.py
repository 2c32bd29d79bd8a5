"""Serves other programs between frames: subscriptions to raw frames, keys and requests, within a budget of time."""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fmfts.bus.control import ControlServer, Request
from fmfts.bus.gate import Gate
from fmfts.bus.joints import JointListener
from fmfts.bus.publisher import Publisher
from fmfts.runtime.fast_loop import FastLoop
from fmfts.runtime.schedule import NEVER_NS, Schedule

# Time of the loop that peers may take at once, plus one request. Frames that arrive meanwhile wait.
BUDGET_NS = 500_000
# Afterwards frames have the loop for this many times as long: peers take at most a fifth of a processor.
PAUSES = 4


@dataclass(frozen=True, slots=True)
class Servers:
    """The sockets to which peers are connected. hear: gets the positions that `joints` received, and their time."""

    publisher: Publisher
    control: ControlServer
    gate: Gate | None = None
    joints: JointListener | None = None
    hear: Callable[[Mapping[str, float], int], None] = lambda position_rad, time_ns: None


class Peers:
    """The loop calls `serve` in each turn; peers wait while they have used up their time.

    ZeroMQ signals only changes, and sending may consume a signal. So the loop calls at regular intervals too, and peers
    are served for as long as there may be a request.

    due_ns: when to call `serve` even if `schedule` was not called.
    """

    def __init__(
        self,
        schedule: Schedule,
        fast_loop: FastLoop,
        servers: Servers,
        handle: Callable[[Request], None],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._schedule = schedule
        self._fast_loop = fast_loop
        self._servers = servers
        self._handle = handle
        self._clock = clock
        # One descriptor for all servers, so that one call silences them while frames have the loop.
        self._doors = select.epoll()
        for door in (servers.control, servers.publisher, servers.gate, servers.joints):
            if door is not None:
                self._doors.register(door.fileno(), select.EPOLLIN)
        self._schedule.wake_for(self._doors.fileno())
        self._is_wanted = self._is_silenced = False
        self.due_ns = NEVER_NS

    def serve(self, called: bool) -> None:
        """Serve peers for BUDGET_NS at most, or not at all in a pause. called: something may have arrived."""
        self._is_wanted |= called or self._servers.control.may_have_more
        begun_ns = self._clock()
        if self._is_silenced and begun_ns < self.due_ns:
            return
        if self._is_silenced:
            self._schedule.wake_for(self._doors.fileno())
            self._is_silenced, self.due_ns = False, NEVER_NS
        if self._is_wanted:
            self._is_wanted = self._serve_until(begun_ns + BUDGET_NS)
            self._pause(begun_ns)

    def close(self) -> None:
        self._doors.close()

    def _serve_until(self, end_ns: int) -> bool:
        """True if there may be more."""

        def time_is_up() -> bool:
            return self._clock() >= end_ns

        servers = self._servers
        more_joints = servers.joints is not None and self._hear_until(servers.joints, time_is_up)
        if servers.publisher.has_new_subscriber(time_is_up):
            self._fast_loop.end_recorded(self._clock())
        more_keys = servers.gate is not None and servers.gate.answer(time_is_up)
        served = 0
        while servers.control.serve_one(self._handle):
            served += 1
            if time_is_up():
                break
        if served:
            self._schedule.review()
        return servers.control.may_have_more or servers.publisher.may_have_more or more_keys or more_joints

    def _hear_until(self, joints: JointListener, time_is_up: Callable[[], bool]) -> bool:
        """True if there may be more: ZeroMQ signals again only after all is read."""
        while (positions := joints.receive(time_is_up)) is not None:
            self._servers.hear(*positions)
            if time_is_up():
                return True
        return joints.may_have_more

    def _pause(self, begun_ns: int) -> None:
        now_ns = self._clock()
        self.due_ns = now_ns + PAUSES * (now_ns - begun_ns)
        self._schedule.sleep_through(self._doors.fileno())
        self._is_silenced = True
