"""When a board's samples were taken, on the host's CLOCK_MONOTONIC: clock.h says how its clock is followed."""

from __future__ import annotations

from fmfts.common.record import Record
from fmfts.sensor.wire import _wire

LINE_BYTES = Record(_wire.CLOCK).buffer.nbytes


class HostClock:
    """The clock of a source on this host: its device time already is CLOCK_MONOTONIC."""

    drift_ppm = 0.0

    def __init__(self) -> None:
        self.restarts = 0
        line = Record(_wire.CLOCK)
        line.put("is_host", 1)
        self.line = line.buffer

    def found_empty(self, at_ns: int) -> None:
        """See DeviceClock; not needed here."""

    def to_host_ns(self, device_us: int, arrival_ns: int) -> int:
        return _wire.host_time(self.line, device_us, arrival_ns)

    def is_plausible(self, device_us: int, arrival_ns: int) -> bool:
        return True

    def restart(self) -> None:
        """Nothing to do: there is no learned map."""
        self.restarts += 1


class DeviceClock:
    """A free-running clock with `tolerance` (relative: 200e-6 for a crystal, 0.02 for an RC oscillator).

    A new fixed_delay_ns, the known delay of every packet, is used from the next `restart` on. line: what C learns from
    the packets that it handles itself: fmfts_clock_line.
    """

    def __init__(self, tolerance: float = 0.02, fixed_delay_ns: int = 0) -> None:
        self.fixed_delay_ns = fixed_delay_ns
        self.restarts = -1
        self._line = Record(_wire.CLOCK)
        self.line = self._line.buffer  # kept: to view it takes longer than to ask C
        self.tolerance = tolerance
        self.restart()

    def found_empty(self, at_ns: int) -> None:
        """All bytes that arrived before `at_ns` were read: later ones have waited at most since then."""
        self._line.put("empty_ns", at_ns)

    def restart(self) -> None:
        """Forget everything: the board was reset, or the line was closed."""
        self.restarts += 1
        self._line.put("fixed_delay_ns", self.fixed_delay_ns)
        _wire.restart(self.line)

    @property
    def tolerance(self) -> float:
        """How far the board's clock may be off, relative."""
        return self._line.number("tolerance_ns_per_us") / 1000.0

    @tolerance.setter
    def tolerance(self, tolerance: float) -> None:
        self._line.put("tolerance_ns_per_us", tolerance * 1000.0)

    @property
    def drift_ppm(self) -> float:
        """By how much the board's clock is slower than the host's."""
        return self._line.number("slope_ns_per_us") * 1000.0

    @property
    def newest_us(self) -> int:
        """The newest time of the board that it learned from."""
        return self._line.integer("newest_us")

    @property
    def has_begun(self) -> bool:
        """Whether it learned from any packet since `restart`."""
        return bool(self._line.integer("begun"))

    def since_newest_ns(self, arrival_ns: int) -> float:
        """How long before `arrival_ns` the newest packet that it learned from was due."""
        return _wire.above_line(self.line, self.newest_us, arrival_ns)

    def unread_ns(self, arrival_ns: int) -> float:
        """How long a packet may have waited because the host did not read; 0 if that was never reported."""
        empty_ns = self._line.integer("empty_ns")
        return float(arrival_ns - empty_ns) if empty_ns else 0.0

    def is_plausible(self, device_us: int, arrival_ns: int) -> bool:
        """Whether this time fits the learned map. If not, `to_host_ns` restarts."""
        return _wire.goes_on(self.line, device_us, arrival_ns)

    def at_ns(self, device_us: int, arrival_ns: int) -> int:
        """Like `to_host_ns`, for an earlier packet by the present map."""
        above_ns = _wire.above_line(self.line, device_us, arrival_ns)
        return arrival_ns - max(0, int(above_ns)) - self._line.integer("fixed_delay_ns")

    def to_host_ns(self, device_us: int, arrival_ns: int) -> int:
        """Host time of `device_us`, never later than its arrival at `arrival_ns`. Learns from the arrival."""
        if not self.is_plausible(device_us, arrival_ns):
            self.restart()
        return _wire.host_time(self.line, device_us, arrival_ns)
