"""Decides which samples of a line are used: those of the right board, by its hello, at a plausible time."""

from __future__ import annotations

from collections.abc import Mapping

from fmfts.sensor.chips import Chip
from fmfts.sensor.early import EarlySample
from fmfts.sensor.frame import READING_BYTES, Frame, WireFrame, bits
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire import faults
from fmfts.sensor.wire.board import Board
from fmfts.sensor.wire.clock import DeviceClock, HostClock
from fmfts.sensor.wire.framing import PackedEarly, PackedSample
from fmfts.sensor.wire.line_guard import NOT_YET, LineGuard
from fmfts.sensor.wire.packets import TEMPERATURE_UNKNOWN, Sample, Verb
from fmfts.sensor.wire.requests import Requests
from fmfts.sensor.wired_pad import WiredPad

TOO_LATE_NS = 1_000_000  # correct a time if other packets of the same read show that it is too late by more than this


class Admission:
    """guard: notices other boards on the line. hello_came: after the last sample."""

    def __init__(
        self,
        pads: Mapping[int, WiredPad],
        state: SourceState,
        clock: DeviceClock | HostClock,
        board: Board,
        requests: Requests,
    ) -> None:
        self.hello_came = False
        self.guard = LineGuard(requests)
        self._pads, self._state, self._clock, self._board, self._requests = pads, state, clock, board, requests
        self._misfits = 0
        self._accepted: dict[tuple[int, int], Chip] = {}  # by (pad index, bytes of readings): they agree with the hello

    def restart(self) -> None:
        """The line was newly opened."""
        self._misfits = 0
        self.guard = LineGuard(self._requests)
        self._accepted.clear()

    def forget_hello(self) -> None:
        """Compare the next samples with the hello again."""
        self._accepted.clear()

    def has_taken(self, pad_index: int) -> bool:
        """Samples of this pad came from the right board and agreed with its hello."""
        return any(pad_index == accepted for accepted, _ in self._accepted)

    def wire_frame(self, sample: PackedSample, now_ns: int) -> Frame | None:
        pad_index, sequence, time_us, temperature_raw, packed = sample
        key = pad_index, len(packed[3])
        chip = self._accepted.get(key)
        if chip is not None:
            host_time_ns = self.host_time_ns(time_us, now_ns, pad_index, sequence)
        else:
            host_time_ns = self._admitted(pad_index, len(packed[3]) // READING_BYTES, time_us, now_ns, sequence)
        if host_time_ns is None:
            return None
        if chip is None:
            chip = self._pads[pad_index].chip
            if self._board.hello is not None:
                self._accepted[key] = chip
        temperature_c = None if temperature_raw == TEMPERATURE_UNKNOWN else chip.temperature_c(temperature_raw)
        restarts = self._clock.restarts
        return WireFrame(pad_index, sequence, time_us, host_time_ns, packed, temperature_c, run=restarts, chip=chip)

    def early(self, early: PackedEarly, now_ns: int) -> EarlySample | None:
        pad_index, sensor, gain_code, time_us, counts = early
        pad = self._pads.get(pad_index)
        if pad is None or not pad.early or not self._board.is_right:
            return None  # another host may have asked for it: the first hello ends that
        if not self.fits("early sample", pad_index, pad.sensors):
            return None
        if sensor >= pad.sensors:
            self.leave_out("early sample", f"the pad has no sensor {sensor} (they count from 0)")
        elif self.guard.crowd is not None or not self._clock.is_plausible(time_us, now_ns):
            pass  # frames already report that
        else:
            return EarlySample(pad_index, sensor, time_us, gain_code, counts, pad.chip)
        return None

    def host_time_ns(self, time_us: int, now_ns: int, counted: object, number: int) -> int | None:
        """The host's time of a packet's sample; None if it is refused. number: the packet's, in the series
        `counted`."""
        if (why := self.guard.why_not(self._clock, time_us, now_ns, counted, number)) is not None:
            if why is not NOT_YET:
                self.leave_out("sample", why)
            return None
        restarts = self._clock.restarts
        host_time_ns = self._clock.to_host_ns(time_us, now_ns)
        hello_came, self.hello_came = self.hello_came, False
        if self._clock.restarts != restarts:
            # After a reset the board has its default settings, and its hello may be lost.
            self._requests.ask(Verb.HELLO)
            if not hello_came and self._board.was_reset():
                self._accepted.clear()
                return None
        return host_time_ns

    def _admitted(self, pad_index: int, sensors: int, time_us: int, now_ns: int, sequence: int) -> int | None:
        """The time of a sample; None if its pad is not configured, or contradicts its configuration."""
        if not self.fits("sample", pad_index, sensors):
            return None
        host_time_ns = self.host_time_ns(time_us, now_ns, pad_index, sequence)
        if host_time_ns is None:
            return None
        if pad_index not in self._pads or not self._board.is_right:
            return None
        wrong = self._board.mismatch(pad_index, sensors)
        faults.note(self._state.pad_faults, pad_index, wrong)
        return host_time_ns if wrong is None else None

    def frame(self, sample: Sample, now_ns: int) -> Frame | None:
        sensors = len(sample.counts)
        host_time_ns = self._admitted(sample.pad_index, sensors, sample.time_us, now_ns, sample.sequence)
        if host_time_ns is None:
            return None
        chip, raw = self._pads[sample.pad_index].chip, sample.temperature_raw
        return Frame(
            sample.pad_index,
            sample.sequence,
            sample.time_us,
            host_time_ns,
            sample.gain_code,
            sample.counts,
            sample.age_us,
            bits(sample.fresh, sensors),
            bits(sample.valid, sensors),
            None if raw == TEMPERATURE_UNKNOWN else chip.temperature_c(raw),
            self._clock.restarts,
            chip,
        )

    def fits(self, what: str, pad_index: int, sensors: int) -> bool:
        why = self._board.contradiction(pad_index, sensors)
        if why is not None:
            self.leave_out(what, why)
        return why is None

    def leave_out(self, what: str, why: str) -> None:
        self._misfits += 1
        self._state.warnings["packets"] = faults.misfits(self._misfits, what, why)


def timed_together(frames: list[Frame], clock: DeviceClock | HostClock, arrival_ns: int) -> list[Frame]:
    """Frames of one read. Where a clock has just begun, only the last of them shows how long the others waited."""
    mine = [number for number, frame in enumerate(frames) if frame.run == clock.restarts]
    if not mine or not isinstance(clock, DeviceClock):
        return frames
    first = frames[mine[0]]
    if first.host_time_ns - clock.at_ns(first.device_time_us, arrival_ns) > TOO_LATE_NS:
        for number in mine:
            frames[number] = frames[number].at(clock.at_ns(frames[number].device_time_us, arrival_ns))
    return frames
