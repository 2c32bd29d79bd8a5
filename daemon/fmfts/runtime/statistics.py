"""A pad's actual rate, gaps and latency. The status publishes it once a second; counters only grow."""

from __future__ import annotations

from dataclasses import dataclass, field

from fmfts.pipeline.encoded import Passed
from fmfts.sensor import Frame
from fmfts.sensor.numbering import MOST_MISSING, NUMBERS, missing

RESET_NS = 20_000_000  # no board starts faster; packets that come again are older than the last one


@dataclass(slots=True)
class PadStatistics:
    """Counters since the start, and the latencies (sample → publish) since the last `interval`.

    gaps: frames that are missing between two frames of one run of the source. How many were lost between two runs is
    not known, because a board that restarts counts from 0 again.
    dropped: frames that arrived and were not used. repeated: those of them that came again, or after a newer one.
    overloaded: share of the last interval's frames that were left out because this computer was late.
    """

    frames: int = 0
    gaps: int = 0
    dropped: int = 0
    repeated: int = 0
    rate_hz: float = 0.0
    overloaded: float = 0.0
    _last: tuple[int, int] | None = None  # run, sequence
    _last_times: tuple[int, int] = (0, 0)  # on the board's clock in µs, on the host's in ns
    _expected: int | None = None  # the sequence after an impossible one
    _first_ns: int | None = None
    _sampled_ns: int = 0  # of the last message
    _left_out: int = 0  # dropped frames, minus those that sequence numbers have shown to be missing
    _arrived: tuple[int, int] = (0, 0)  # frames, and those left out, since the last `interval`
    _published: int = 0  # messages since the last `interval`
    _latencies_s: list[float] = field(default_factory=list)

    def frame(self, frame: Frame) -> bool:
        """Count a frame, and the frames missing before it: the jump of the sequence number within a run.

        False if the frame came before, or if its number cannot be: so many frames cannot be missing. Two consecutive
        frames with such numbers are accepted, unless they are no newer than the last one: any number of frames may be
        repeated in their order.
        """
        self._arrive(1)
        if self._last is not None and self._last[0] == frame.run:
            lost = missing(frame.sequence, self._last[1])
            if lost > MOST_MISSING:
                is_newer = self._is_newer(frame)
                if not is_newer or frame.sequence != self._expected:
                    self.dropped += 1
                    self.repeated += not is_newer
                    self._expected = (frame.sequence + 1) % NUMBERS if is_newer else self._expected
                    return False
                lost = 0
            self._miss(lost)
        self._last, self._expected = (frame.run, frame.sequence), None
        self._last_times = frame.device_time_us, frame.host_time_ns
        return True

    def start_anew(self) -> None:
        """The source was replaced, and its sequence numbers begin anew."""
        self._last = self._expected = None

    def reject(self) -> None:
        """Count an impossible frame: it arrived, and is not used."""
        self._arrive(1)
        self.dropped += 1

    def _is_newer(self, frame: Frame) -> bool:
        """Whether a frame was made after the last one. A replay does not say that the board was reset in between."""
        last_us, last_ns = self._last_times
        return frame.device_time_us > last_us or frame.host_time_ns > last_ns + RESET_NS

    def leave_out(self, count: int) -> None:
        """Count frames that arrived and were left out before anybody looked at their sequence numbers."""
        self._arrive(count)
        self._left_out += count
        self.refuse(count)

    def refuse(self, count: int = 1) -> None:
        """Count frames that arrived, and were left out because they were late."""
        self.dropped += count
        self._arrived = self._arrived[0], self._arrived[1] + count

    def _arrive(self, count: int) -> None:
        self.frames += count
        self._arrived = self._arrived[0] + count, self._arrived[1]

    def _miss(self, count: int) -> None:
        """Count frames that the sequence numbers show to be missing, and that were not left out here."""
        explained = min(max(count, 0), self._left_out)
        self._left_out -= explained
        self.gaps += max(count, 0) - explained

    def published(self, sampled_ns: int, published_ns: int) -> None:
        """Count a message. A message without a new sample has no latency: `t_sample_ns` says how old its sample is."""
        self._published += 1
        if sampled_ns != self._sampled_ns:
            self._latencies_s.append((published_ns - sampled_ns) * 1e-9)
        self._sampled_ns = sampled_ns

    def passed(self, passed: Passed) -> None:
        """Count the frames that C handled; they are of the same run as the last one."""
        if not passed.frames:
            return
        self._arrive(passed.frames)
        before = passed.first_sequence - 1
        if self._last is not None:
            run, before = self._last
            self._last = run, passed.sequence
            self._last_times = passed.frame_us, passed.frame_ns
        self._miss(passed.sequence - before - passed.frames)
        self._published += passed.frames
        self._latencies_s += passed.latencies_s
        self._sampled_ns = passed.t_sample_ns

    def interval(self, now_ns: int) -> tuple[float, float, float] | None:
        """End the interval; sets `rate_hz` and `overloaded`.

        Returns latencies p50, p99, max in s; None if no sample was published.
        """
        if self._first_ns is not None and now_ns > self._first_ns:
            self.rate_hz = self._published / ((now_ns - self._first_ns) * 1e-9)
        self.overloaded = self._arrived[1] / max(self._arrived[0], 1)
        self._first_ns, self._published, self._arrived = now_ns, 0, (0, 0)
        count = len(self._latencies_s)
        if not count:
            return None
        ordered = sorted(self._latencies_s)
        self._latencies_s.clear()
        return ordered[count // 2], ordered[min(count - 1, int(count * 0.99))], ordered[-1]
