"""When was a packet made, of a stream that carries no time? And how many packets are missing?

The board sends at a steady rate. So packets are numbered as they come, their number times the period is a board's
time, and `DeviceClock` finds the line below all arrivals, as for boards that tell their time. Where packets are lost,
all that follow are late by whole periods: then the numbers skip as many.
"""

from __future__ import annotations

from bisect import bisect

from fmfts.sensor.wire.clock import DeviceClock

LEARNING_NS = 500_000_000  # time over which the period is measured, and accepted if both halves agree
LONGEST_LEARNING_NS = 3_000_000_000
CHECK_NS = 1_000_000_000  # time over which the period is measured again
PERIOD_TOLERANCE = 0.02
LATE_PACKETS = 8
LATE_NS = 100_000_000  # if all are later than this for this long, the clock begins anew, however long they waited here
LATE_PERIODS = 0.6
PAUSE_NS = 1_000_000_000  # after a longer silence the clock begins anew, because nobody can count the lost packets


class StreamClock:
    """lost: packets that never came. period_ns: 0 while it is being learned. epochs: how often numbers began anew."""

    def __init__(self) -> None:
        self.clock = DeviceClock()
        self.clock.tolerance = PERIOD_TOLERANCE
        self.lost = self.epochs = 0
        self.restart()

    def restart(self, period_ns: float = 0.0) -> None:
        """The stream begins anew, with a period that is known, or that has to be learned."""
        self.clock.restart()
        self.period_ns = period_ns
        self.number = 0
        self.epochs += 1
        self._heard_ns = 0
        self._begun_ns = 0  # to learn
        self._measured: list[int] = []  # arrivals from which the period is measured
        self._other_ns = 0.0  # a new period, if the last second shows one
        self._lateness: list[tuple[int, int]] = []  # arrival, and how late

    @property
    def rate_hz(self) -> float | None:
        return 1e9 / self.period_ns if self.period_ns else None

    def stamped(self, arrival_ns: int) -> tuple[int, int, int] | None:
        """The next packet's number, board's time in µs and host's time in ns; None while the period is learned."""
        if self._heard_ns and arrival_ns - self._heard_ns > PAUSE_NS:
            self.restart()
        self._heard_ns = arrival_ns
        self._measured.append(arrival_ns)
        if not self.period_ns:
            self._learn(arrival_ns)
            return None
        self._check(arrival_ns)
        self.number += 1
        device_us = round(self.number * self.period_ns / 1000)
        host_ns = self.clock.to_host_ns(device_us, arrival_ns)
        self._look_for_a_gap(arrival_ns, arrival_ns - host_ns)
        return self.number, device_us, host_ns

    def _learn(self, arrival_ns: int) -> None:
        self._begun_ns = self._begun_ns or arrival_ns
        if arrival_ns - self._measured[0] < LEARNING_NS:
            return
        if is_steady(self._measured) or arrival_ns - self._begun_ns >= LONGEST_LEARNING_NS:
            self.period_ns, self._measured = period_of(self._measured), []
        else:  # earlier packets may have waited for the port to be opened
            self._measured = halves_of(self._measured)[1]

    def _check(self, arrival_ns: int) -> None:
        """Two seconds in a row with the same new period: a busy computer caused the learned one."""
        if arrival_ns - self._measured[0] < CHECK_NS:
            return
        measured, self._measured = self._measured, []
        found_ns = period_of(measured)
        if is_near(found_ns, self.period_ns) or not is_steady(measured):
            self._other_ns = 0.0
        elif self._other_ns and is_near(found_ns, self._other_ns):
            self.restart(found_ns)
        else:
            self._other_ns = found_ns

    def found_empty(self, at_ns: int) -> None:
        """Nothing that arrived before `at_ns` is unread: see DeviceClock."""
        self.clock.found_empty(at_ns)

    def _look_for_a_gap(self, arrival_ns: int, late_ns: int) -> None:
        if late_ns < LATE_PERIODS * self.period_ns:
            self._lateness.clear()
            return
        late_ns -= round(self.clock.unread_ns(arrival_ns))  # a packet may have waited here for this long
        if late_ns < LATE_PERIODS * self.period_ns:
            return
        self._lateness.append((arrival_ns, late_ns))
        if len(self._lateness) < LATE_PACKETS or arrival_ns - self._lateness[0][0] < LATE_NS:
            return
        least_ns = min(late for _, late in self._lateness)
        missing = round(least_ns / self.period_ns)
        self.lost += missing
        self.number += missing
        self._lateness.clear()


def halves_of(arrivals_ns: list[int]) -> tuple[list[int], list[int]]:
    """The halves by time, not by number."""
    middle = bisect(arrivals_ns, (arrivals_ns[0] + arrivals_ns[-1]) // 2)
    return arrivals_ns[:middle], arrivals_ns[middle:]


def is_steady(arrivals_ns: list[int]) -> bool:
    """Whether each half has the period of the whole: a burst of packets that waited is in one of them."""
    whole_ns = period_of(arrivals_ns)
    return all(len(half) > 2 and is_near(period_of(half), whole_ns) for half in halves_of(arrivals_ns))


def is_near(period_ns: float, other_ns: float) -> bool:
    return abs(period_ns - other_ns) <= PERIOD_TOLERANCE * other_ns


def period_of(arrivals_ns: list[int]) -> float:
    """ns between two packets, from the least late of the first third to the least late of the last."""
    last = len(arrivals_ns) - 1
    period_ns = (arrivals_ns[-1] - arrivals_ns[0]) / last
    third = last // 3
    for _ in range(2):
        lateness = [arrival - number * period_ns for number, arrival in enumerate(arrivals_ns)]
        early = min(range(third + 1), key=lateness.__getitem__)
        late = min(range(last - third, last + 1), key=lateness.__getitem__)
        period_ns = (arrivals_ns[late] - arrivals_ns[early]) / (late - early)
    return period_ns
