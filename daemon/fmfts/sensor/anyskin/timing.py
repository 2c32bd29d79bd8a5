"""When was a packet made, of a stream that carries no time? And how many packets are missing?

The board sends at a steady rate. So packets are numbered as they come, their number times the period is a board's
time, and `DeviceClock` finds the line below all arrivals, as for boards that tell their time. Where packets are lost,
all that follow are late by whole periods: then the numbers skip as many.
"""

from __future__ import annotations

from fmfts.sensor.wire.clock import DeviceClock

LEARNING_NS = 500_000_000  # in which the period is measured: to about 1 % where packets come in pairs
PERIOD_TOLERANCE = 0.02
LATE_PACKETS, LATE_NS = (
    8,
    100_000_000,
)  # all later than that for so long: a stall of this computer is shorter, or ends on time
LATE_PERIODS = 0.6
PAUSE_NS = 1_000_000_000  # a longer silence begins anew: how many packets it cost is only as certain as the period


class StreamClock:
    """lost: packets that never came. period_ns: 0 while it is being learned."""

    def __init__(self) -> None:
        self.clock = DeviceClock()
        self.clock.tolerance = PERIOD_TOLERANCE
        self.lost = 0
        self.restart()

    def restart(self) -> None:
        """The stream begins anew."""
        self.clock.restart()
        self.period_ns = 0.0
        self.number = 0
        self._first_ns: int | None = None
        self._heard_ns = 0
        self._lateness: list[tuple[int, int]] = []  # arrival, and how late

    @property
    def rate_hz(self) -> float | None:
        return 1e9 / self.period_ns if self.period_ns else None

    def stamped(self, arrival_ns: int) -> tuple[int, int, int] | None:
        """(number, board's time in µs, host's time in ns) of the next packet; None while the period is learned."""
        if self._heard_ns and arrival_ns - self._heard_ns > PAUSE_NS:
            self.restart()
        self._heard_ns = arrival_ns
        if not self.period_ns:
            self._learn(arrival_ns)
            return None
        self.number += 1
        device_us = round(self.number * self.period_ns / 1000)
        host_ns = self.clock.to_host_ns(device_us, arrival_ns)
        self._look_for_a_gap(arrival_ns, arrival_ns - host_ns)
        return self.number, device_us, host_ns

    def _learn(self, arrival_ns: int) -> None:
        if self._first_ns is None:
            self._first_ns = arrival_ns
            return
        self.number += 1
        if arrival_ns - self._first_ns >= LEARNING_NS:
            self.period_ns = (arrival_ns - self._first_ns) / self.number
            self.number = 0

    def _look_for_a_gap(self, arrival_ns: int, late_ns: int) -> None:
        if late_ns < LATE_PERIODS * self.period_ns:
            self._lateness.clear()
            return
        self._lateness.append((arrival_ns, late_ns))
        if len(self._lateness) < LATE_PACKETS or arrival_ns - self._lateness[0][0] < LATE_NS:
            return
        least_ns = min(late for _, late in self._lateness)
        missing = round(least_ns / self.period_ns)
        self.lost += missing
        self.number += missing
        self._lateness.clear()
