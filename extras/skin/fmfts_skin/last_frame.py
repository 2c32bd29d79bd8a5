"""The previous frame, and the time since then, even if the board's clock jumps."""

from __future__ import annotations

from fmfts.pose import _alignment
from fmfts.pose.alignment import Aligned, Alignment, Array
from fmfts.sensor import Frame


class LastFrame:
    """sequence: its number. times: on the board's clock (µs) and on the host's (ns). All are 0 before any frame."""

    def __init__(self, rate_hz: float) -> None:
        self.sequence = 0
        self.times = 0, 0
        self._began = 0, 0  # host's time, and number, of the first frame with the last one's time: a clock may stand
        self._period_us = 1e6 / rate_hz

    def host_time_ns(self, device_time_us: int) -> int:
        """The host's time of the board's, near this frame."""
        frame_us, frame_ns = self.times
        return frame_ns + 1000 * (device_time_us - frame_us)

    def leap_us(self, frame: Frame) -> int:
        """By how much the board's clock jumped between this frame and `frame`, beyond the time that passed."""
        began_ns, number = self._began
        times = frame.device_time_us, frame.host_time_ns, frame.sequence
        return _alignment.leap_us(self.times[0], began_ns, number, *times, self._period_us)

    def aligned(self, frame: Frame, field_t: Array, alignment: Alignment) -> Aligned:
        """Align `frame`, and take it as the last one. field_t (N, 3): its field."""
        leap_us = self.leap_us(frame)
        self.become(frame.sequence, frame.device_time_us, frame.host_time_ns)
        return alignment.push(
            field_t, frame.sampled_us, frame.fresh, frame.timed, frame.device_time_us, leap_us=leap_us
        )

    def become(self, sequence: int, device_time_us: int, host_time_ns: int) -> None:
        """Take a frame with this number and these times as the last one."""
        if device_time_us != self.times[0]:
            self._began = host_time_ns, sequence
        self.sequence, self.times = sequence, (device_time_us, host_time_ns)
