"""Refuses packets with an impossible time: ahead of the time that passed here, or repeated.

A valid packet may be old because something on the line sent it again, or because its sender's memory was damaged. The
clock would take it for a reset of the board, and the next packet for another reset. After a real reset, a jump of the
clock, or a suspended computer, the next packets are consistent with each other, as those of a running clock are, or a
hello precedes them.

Repeated packets have old numbers, so a clock that jumps back while the numbers continue is accepted at once.

A clock never begins with a packet that may have waited here because this host did not read: all later packets would
seem younger by that wait. The next packet decides, if it is read later, and the same time passed on both clocks.
"""

from __future__ import annotations

from fmfts.sensor.numbering import is_next
from fmfts.sensor.wire._wire import JUMP_NS
from fmfts.sensor.wire.clock import DeviceClock

# This many consistent packets in a row show a running clock: a reset board, whose hello was lost.
CONVINCING = 3
# Packets that are repeated from the last RECENT_US are consistent with each other, too. A reset board's clock begins at
# zero, so it shows at most REPEATED_NS more than the time since the newest packet. Packets that may be a reset board's
# must come for REPEATED_NS, all others for RECENT_US.
RECENT_US = 10_000_000
REPEATED_NS = 100_000_000
# How far the steps of time and arrival may differ besides JUMP_NS: an RC oscillator's tolerance, twice.
STEP_SHARE = 0.04


class TimeGate:
    """Judges the times of one board's packets, before its clock learns from them.

    waits: the last one was not admitted only because it may have waited here.
    """

    def __init__(self) -> None:
        self.waits = False
        self._strange: tuple[int, int] | None = None  # time in µs and arrival in ns of the last one
        self._last_of_read: tuple[int, int] | None = None  # last packet of the read before: it waited least
        self._count = 0
        self._since_ns = 0
        self._hello = False
        self._newest_us = 0  # newest time of the clock when something strange or a hello came
        self._numbers: dict[object, int] = {}  # the newest admitted one of each sequence of numbers

    def hello(self, clock: DeviceClock) -> None:
        """The board sent a hello unasked, as after a reset: the next packet has its new time."""
        self._forget_if_it_went_on(clock)
        self._hello = True

    def passed(self, counted: object, number: int) -> None:
        """Another reader admitted packets; `number` was the last one of the series `counted`."""
        self._numbers[counted] = number

    def admits(self, clock: DeviceClock, device_us: int, arrival_ns: int, counted: object, number: int) -> bool:
        """Whether `clock` may learn from a packet with this time. number: the packet's, in the series `counted`: each
        pad has its own."""
        before = self._numbers.get(counted)
        has_next_number = before is not None and is_next(number, before)
        was_here_before = clock.has_begun and device_us <= clock.newest_us and clock.is_plausible(device_us, arrival_ns)
        is_admitted = self._admits(clock, device_us, arrival_ns, has_next_number)
        if is_admitted and (has_next_number or not was_here_before):
            self._numbers[counted] = number
        return is_admitted

    def _admits(self, clock: DeviceClock, device_us: int, arrival_ns: int, has_next_number: bool) -> bool:
        self._forget_if_it_went_on(clock)
        self.waits = False
        if clock.has_begun and clock.is_plausible(device_us, arrival_ns):
            self._forget()
            return True
        if clock.has_begun and self._is_no_evidence(device_us):
            return False
        before_us, before_ns = (device_us, arrival_ns) if self._strange is None else self._strange
        if not clock.has_begun and device_us < before_us and arrival_ns - before_ns <= REPEATED_NS:
            self.waits = True  # a repeated packet: newer ones came just now, and the clock begins with one of those
            return False
        goes_on = self._goes_on(device_us, arrival_ns)
        is_new = clock.unread_ns(arrival_ns) <= JUMP_NS or (goes_on and arrival_ns - before_ns > JUMP_NS)
        is_new |= has_next_number and self._kept_pace(device_us, arrival_ns)
        is_believed = self._is_believed(clock, device_us, arrival_ns, goes_on, has_next_number)
        self.waits = is_believed and not is_new
        if is_believed and is_new:
            self._forget()
            return True
        return False

    def _forget(self) -> None:
        self._strange, self._last_of_read, self._count, self._hello = None, None, 0, False

    def _forget_if_it_went_on(self, clock: DeviceClock) -> None:
        """Plausible packets may have come that this gate never saw: the fast loop reads them."""
        newest_us = clock.newest_us
        if newest_us != self._newest_us:
            self._forget()
            self._newest_us = newest_us

    def _is_no_evidence(self, device_us: int) -> bool:
        """Whether a strange packet is the last one's copy, or was overtaken by it."""
        return self._strange is not None and 0 <= 1000 * (self._strange[0] - device_us) < JUMP_NS

    def _is_believed(
        self, clock: DeviceClock, device_us: int, arrival_ns: int, goes_on: bool, has_next_number: bool
    ) -> bool:
        """A strange time: whether the clock restarted. goes_on: consistent with the strange one before."""
        if goes_on:
            self._count += 1
        else:
            self._count, self._since_ns = 1, arrival_ns
        if self._strange is not None and self._strange[1] != arrival_ns:
            self._last_of_read = self._strange
        self._strange = device_us, arrival_ns
        if not clock.has_begun:
            return True
        back_us = clock.newest_us - device_us
        if self._hello and back_us > 0:
            return True
        needed_ns = 0
        if 0 < back_us <= RECENT_US and not has_next_number:
            may_be_reset = 1000 * device_us <= clock.since_newest_ns(arrival_ns) + REPEATED_NS
            needed_ns = REPEATED_NS if may_be_reset else 1000 * RECENT_US
        return self._count >= CONVINCING and arrival_ns - self._since_ns >= needed_ns

    def _goes_on(self, device_us: int, arrival_ns: int) -> bool:
        """Whether as much time passed on both clocks since the last strange packet."""
        return self._strange is not None and _passed_alike(self._strange, device_us, arrival_ns)

    def _kept_pace(self, device_us: int, arrival_ns: int) -> bool:
        """The same since the last packet of the read before, if that is some time ago."""
        before = self._last_of_read
        return before is not None and arrival_ns - before[1] > JUMP_NS and _passed_alike(before, device_us, arrival_ns)


def _passed_alike(before: tuple[int, int], device_us: int, arrival_ns: int) -> bool:
    there_ns, here_ns = 1000 * (device_us - before[0]), arrival_ns - before[1]
    return there_ns >= 0 and abs(there_ns - here_ns) <= JUMP_NS + STEP_SHARE * here_ns
