"""Maps a board's microseconds to the host's CLOCK_MONOTONIC: when was a sample taken?

The delay of a packet is never negative and often near its minimum. So the map is a line below all points (device time,
arrival). Its slope comes from the lower convex hull of the last half minute (Moon, Skelly, Towsley 1999), its height
from the earliest arrivals of the last seconds. No host can measure the constant part of the delay; the caller gives
what it knows of it as `fixed_delay_ns`.

A packet far above the line is late and changes nothing: after a stall, a host gets its backlog in one burst. If only
late packets arrive for a while, the board's clock has stood still, and the line moves up. Packets that may have waited
because this host did not read do not count for that: whoever reads says when nothing was left unread.
"""

from __future__ import annotations

import math
import struct
from itertools import chain, pairwise

from fmfts.sensor.wire import _wire

BUCKET_US = 250_000
SLOPE_BUCKETS = 128  # 32 s: the drift of a crystal is constant over that, that of an RC oscillator nearly
HEIGHT_BUCKETS = 16  # 4 s: longer than a short stall of the host, so short that an error of the slope does not matter
JUMP_NS = 20_000_000  # pads of one board interleave within a few ms; a larger step is a reset, or a suspended host
STANDSTILL_NS = 400_000_000  # only late packets for so long: the board's clock stood still
# At a few Hz two late packets in a row may be chance, and a backlog comes in a few bursts. So a standstill needs this
# many late packets, each this long after the last one that counted.
STANDSTILL_PACKETS = 8
LATE_APART_NS = STANDSTILL_NS // (STANDSTILL_PACKETS - 1)

# fmfts_clock_line of clock.h: empty_ns and is_host; the learned line and the limits; the lowest packets of the last
# buckets.
HEAD = struct.Struct("=2q")
LINE = struct.Struct("=8q3d5q2dq")
MINIMA_BYTES = SLOPE_BUCKETS * struct.calcsize("=2q")
LINE_BYTES = HEAD.size + LINE.size + MINIMA_BYTES

Point = tuple[int, int]  # device time in µs, arrival in ns minus 1000 × device time; both since the first packet


class HostClock:
    """The clock of a source on this host: its device time already is CLOCK_MONOTONIC."""

    drift_ppm = 0.0

    def __init__(self) -> None:
        self.restarts = 0
        self.line = bytearray(LINE_BYTES)
        HEAD.pack_into(self.line, 0, 0, 1)

    def found_empty(self, at_ns: int) -> None:
        """See DeviceClock; here nothing follows from it."""

    def to_host_ns(self, device_us: int, arrival_ns: int) -> int:
        return min(device_us * 1000, arrival_ns)

    def is_plausible(self, device_us: int, arrival_ns: int) -> bool:
        return True

    def restart(self) -> None:
        """There is nothing to forget."""
        self.restarts += 1


class DeviceClock:
    """A free-running clock with `tolerance` (relative: 200e-6 for a crystal, 0.02 for an RC oscillator).

    A new fixed_delay_ns, the known delay of every packet, is used from the next `restart` on.
    """

    def __init__(self, tolerance: float = 0.02, fixed_delay_ns: int = 0) -> None:
        self._tolerance = tolerance
        self.fixed_delay_ns = fixed_delay_ns
        self.restarts = -1
        self.line = bytearray(LINE_BYTES)
        self.restart()

    def found_empty(self, at_ns: int) -> None:
        """Nothing that arrived before `at_ns` is unread: what is read later has waited no longer than since then."""
        HEAD.pack_into(self.line, 0, at_ns, 0)

    def restart(self) -> None:
        """Forget everything: the board was reset, or the line was closed."""
        self.restarts += 1
        self._origin: Point | None = None
        self._newest_us = 0
        self._bucket_end_us = 0
        self._minima_count = 0
        self._lowest: Point = (0, 0)
        self._slope = 0.0  # ns per µs by which the host's clock outruns the board's
        self._height = 0.0  # ns at device time zero
        self._forget_late()
        self._draw_line()

    @property
    def drift_ppm(self) -> float:
        """By how much the board's clock is slower than the host's."""
        self._take_line()
        return self._slope * 1000.0

    @property
    def tolerance(self) -> float:
        """How far the board's clock may be off, relative."""
        return self._tolerance

    @tolerance.setter
    def tolerance(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._take_line()
        self._draw_line()

    @property
    def newest_us(self) -> int:
        """The newest time of the board that it learned from."""
        newest_us: int = LINE.unpack_from(self.line, HEAD.size)[0]
        return newest_us

    def since_newest_ns(self, arrival_ns: int) -> float:
        """How long before `arrival_ns` the newest packet that it learned from was due."""
        self._take_line()
        return self._above_line(self._point(self._newest_us, arrival_ns))

    @property
    def has_begun(self) -> bool:
        """Whether it learned from any packet since `restart`."""
        return self._origin is not None

    def unread_ns(self, arrival_ns: int) -> float:
        """How long a packet may have waited because the host did not read; 0 if nobody ever told."""
        empty_ns, _ = HEAD.unpack_from(self.line)
        return float(arrival_ns - empty_ns) if empty_ns else 0.0

    def is_plausible(self, device_us: int, arrival_ns: int) -> bool:
        """Whether this time goes on from what was learned. If it does not, `to_host_ns` begins anew."""
        self._take_line()
        return self._origin is None or self._plausible(device_us, arrival_ns)

    def at_ns(self, device_us: int, arrival_ns: int) -> int:
        """The same as `to_host_ns` of a packet that it learned from, by what it knows now."""
        self._take_line()
        return arrival_ns - max(0, int(self._above_line(self._point(device_us, arrival_ns)))) - self.fixed_delay_ns

    def to_host_ns(self, device_us: int, arrival_ns: int) -> int:
        """Host time of `device_us`, never later than its arrival at `arrival_ns`. Learns from the arrival."""
        host_ns = _wire.host_time(self.line, device_us, arrival_ns)
        return self._in_python(device_us, arrival_ns) if host_ns is None else host_ns

    def _in_python(self, device_us: int, arrival_ns: int) -> int:
        self._take_line()
        host_ns = self._to_host_ns(device_us, arrival_ns)
        self._draw_line()
        return host_ns

    def _take_line(self) -> None:
        """Read what C learned from the packets that it handled."""
        values = LINE.unpack_from(self.line, HEAD.size)
        self._newest_us, self._lowest, self._bucket_end_us = values[0], values[1:3], values[5]
        self._late_packets, self._late_ns, self._least_late_ns, self._height, self._slope = values[6:11]
        self._minima_count = values[-1]

    def _draw_line(self) -> None:
        """Write what C needs to map packets and to learn from them."""
        learnt = self._newest_us, *self._lowest, *(self._origin or (0, 0)), self._bucket_end_us
        late, line = (self._late_packets, self._late_ns, self._least_late_ns), (self._height, self._slope)
        limits = self.fixed_delay_ns, BUCKET_US, STANDSTILL_NS, STANDSTILL_PACKETS, HEIGHT_BUCKETS, JUMP_NS
        LINE.pack_into(self.line, HEAD.size, *learnt, *late, *line, *limits, self.tolerance * 1000, self._minima_count)

    @property
    def _minima(self) -> list[Point]:
        """The lowest packets of the last buckets, oldest first."""
        values = struct.unpack_from(f"={2 * self._minima_count}q", self.line, HEAD.size + LINE.size)
        return list(zip(values[::2], values[1::2], strict=True))

    @_minima.setter
    def _minima(self, points: list[Point]) -> None:
        self._minima_count = len(points)
        struct.pack_into(f"={2 * len(points)}q", self.line, HEAD.size + LINE.size, *chain.from_iterable(points))

    def _to_host_ns(self, device_us: int, arrival_ns: int) -> int:
        if self._origin is not None and not self._plausible(device_us, arrival_ns):
            self.restart()
        if self._origin is None:
            self._begin(device_us, arrival_ns)
        point = self._point(device_us, arrival_ns)
        above_ns, unsure_ns = self._above_line(point), self._unsure_ns(point)
        if above_ns > unsure_ns and above_ns - self.unread_ns(arrival_ns) <= unsure_ns:
            pass  # the host itself may be the cause: the packet says nothing of the board's clock
        elif above_ns > unsure_ns:
            self._late(point, arrival_ns)
        else:
            self._forget_late()
            self._learn(point)
        self._newest_us = max(self._newest_us, device_us)
        return arrival_ns - max(0, int(self._above_line(point))) - self.fixed_delay_ns

    def _begin(self, device_us: int, arrival_ns: int) -> None:
        self._origin = (device_us, arrival_ns - 1000 * device_us)
        self._newest_us = device_us
        self._bucket_end_us = BUCKET_US
        self._lowest = (0, 0)
        self._slope = self._height = 0.0

    def _point(self, device_us: int, arrival_ns: int) -> Point:
        assert self._origin is not None
        return device_us - self._origin[0], arrival_ns - 1000 * device_us - self._origin[1]

    def _plausible(self, device_us: int, arrival_ns: int) -> bool:
        point = self._point(device_us, arrival_ns)
        went_back_ns = 1000 * (self._newest_us - device_us)
        return went_back_ns < JUMP_NS and self._above_line(point) > -self._unsure_ns(point)

    def _unsure_ns(self, point: Point) -> float:
        """How wrong the line may be: the slope may be off by the tolerance since the lowest packet of this bucket."""
        return JUMP_NS + self.tolerance * 1000 * max(point[0] - self._lowest[0], 0)

    def _above_line(self, point: Point) -> float:
        return point[1] - self._height - self._slope * point[0]

    def _learn(self, point: Point) -> None:
        if point[0] >= self._bucket_end_us:
            self._close_bucket(point)
        elif self._lowest[0] < point[0] and self._above_line(point) < self._above_line(self._lowest):
            self._lowest = point
        self._height = min(self._height, point[1] - self._slope * point[0])

    def _forget_late(self) -> None:
        self._late_ns = self._late_packets = 0
        self._least_late_ns = math.inf

    def _late(self, point: Point, arrival_ns: int) -> None:
        """When only late packets came for long enough, move the line up by the delay of the least late one."""
        self._least_late_ns = min(self._least_late_ns, self._above_line(point))
        if self._late_packets and arrival_ns - self._late_ns < LATE_APART_NS:
            return
        self._late_packets += 1
        self._late_ns = arrival_ns
        if self._late_packets < STANDSTILL_PACKETS:
            return
        step_ns = int(self._least_late_ns)
        self._minima = [(time_us, residual + step_ns) for time_us, residual in self._minima]
        self._lowest = (self._lowest[0], self._lowest[1] + step_ns)
        self._height += step_ns
        self._forget_late()
        self._learn(point)

    def _close_bucket(self, first: Point) -> None:
        self._minima = minima = [*self._minima, self._lowest][-SLOPE_BUCKETS:]
        self._bucket_end_us = (first[0] // BUCKET_US + 1) * BUCKET_US
        self._lowest = first
        limit = self.tolerance * 1000
        self._slope = min(limit, max(-limit, _hull_slope(minima)))
        self._height = min(residual - self._slope * time_us for time_us, residual in minima[-HEIGHT_BUCKETS:])


def _hull_slope(points: list[Point]) -> float:
    """Slope of the edge of the lower convex hull that contains the mean time of the points; 0 for a single point."""
    hull: list[Point] = []
    for point in points:
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    mean_us = sum(time_us for time_us, _ in points) / len(points)
    for (start_us, start_ns), (end_us, end_ns) in pairwise(hull):
        if end_us >= mean_us:
            return (end_ns - start_ns) / (end_us - start_us)
    return 0.0


def _turns_down(a: Point, b: Point, c: Point) -> bool:
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
