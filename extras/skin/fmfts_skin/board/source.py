"""Frames from a ReSkin, AnySkin or eFlesh board, as its own firmware streams them. `poll` never waits."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import serial

from fmfts.sensor.bridge import serial_port
from fmfts.sensor.chips.selftest import no_selftest
from fmfts.sensor.frame import AGE_UNKNOWN_US, Frame
from fmfts.sensor.source import CannotError, SourceState
from fmfts.sensor.wire.faults import note
from fmfts.sensor.wired_pad import WiredPad
from fmfts_skin.board.packets import BinaryStream, Packet, TextStream
from fmfts_skin.board.steps import Steps
from fmfts_skin.board.timing import StreamClock

READ_BYTES, READS = 4096, 16
FIRST_BACKOFF_NS = 50_000_000
LONGEST_BACKOFF_NS = 1_000_000_000
SILENCE_NS = 500_000_000  # the slowest of these boards sends 50 packets a second
REOPEN_NS = 5_000_000_000
NOTHING_UT = (math.nan,) * 3
STRANGE_BYTES = 2000  # this many bytes without a packet belong to another stream
SILENT_PACKETS = 100  # a magnetometer without a measurement in this many packets does not answer
RATE_TOLERANCE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class PadOnStream(WiredPad):
    """A board whose own firmware streams, as text or as binary packets."""

    port: str
    baud: int
    is_text: bool


class Anyskin:
    """A Source: one board with one pad. Facts that the board does not send (errors, settings) stay unknown."""

    def __init__(self, pad: PadOnStream) -> None:
        self.state = SourceState(description=f"AnySkin stream on {pad.port}")
        self._pad = pad
        self._clock = StreamClock()
        self._stream: BinaryStream | TextStream = self._new_stream()
        self._steps = Steps()
        self._serial: serial.Serial | None = None
        self._descriptor: int | None = None
        self._attempt_ns = 0
        self._backoff_ns = FIRST_BACKOFF_NS
        self._opened_ns = self._heard_ns = 0
        self._run = 0
        self._strange_bytes = 0
        self._values = np.zeros((pad.sensors, 3), np.int16)
        self._sampled_us = np.zeros(pad.sensors, np.int64)
        self._unmeasured = [0] * pad.sensors

    def fileno(self) -> int | None:
        return self._descriptor

    def deadline_ns(self) -> int | None:
        if self._serial is None:
            return self._attempt_ns
        patience_ns = SILENCE_NS if self.state.connected else REOPEN_NS
        return max(self._heard_ns, self._opened_ns) + patience_ns

    def poll(self, now_ns: int) -> Sequence[Frame]:
        if self._serial is None and (now_ns < self._attempt_ns or not self._open(now_ns)):
            return ()
        frames = self._receive(now_ns)
        if self._serial is not None:
            self._judge(now_ns)
        return frames

    def request_selftest(self, pad_index: int) -> None:
        raise CannotError(f"pad {self._pad.name!r}: {no_selftest(self._pad.chip)}")

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return None

    def close(self) -> None:
        self._release()
        self._attempt_ns = 1 << 62
        self.state.disconnect("closed", time.monotonic_ns())

    def _new_stream(self) -> BinaryStream | TextStream:
        return (TextStream if self._pad.is_text else BinaryStream)(self._pad.sensors)

    def _open(self, now_ns: int) -> bool:
        try:
            self._serial = serial_port.open_raw(self._pad.port, self._pad.baud)
        except OSError as error:
            self.state.disconnect(f"the port {serial_port.why_not_open(self._pad.port, error)}", now_ns)
            self._wait(now_ns)
            return False
        self._descriptor, self._opened_ns = self._serial.fileno(), now_ns
        self._stream, self._steps, self._strange_bytes = self._new_stream(), Steps(), 0
        self._clock.restart()
        return True

    def _receive(self, now_ns: int) -> Sequence[Frame]:
        """The received packets, until nothing is left unread, or for this many reads."""
        assert self._descriptor is not None
        frames: list[Frame] = []
        for _ in range(READS):
            begun_ns = time.monotonic_ns()
            try:
                data = os.read(self._descriptor, READ_BYTES)
            except BlockingIOError:
                self._clock.found_empty(begun_ns)
                break
            except OSError as error:
                self._disconnect(f"the port is gone ({error.strerror}), so plug the board in again", now_ns)
                break
            if not data:
                self._disconnect("the port hung up, so plug the board in again", now_ns)
                break
            frames += self._frames(data, time.monotonic_ns())  # not `now_ns`: bytes may have arrived since
        return frames

    def _frames(self, data: bytes, arrival_ns: int) -> list[Frame]:
        before = self._stream.garbage_bytes
        packets = list(self._stream.feed(data))
        self.state.garbage_bytes += self._stream.garbage_bytes - before
        self._strange_bytes = 0 if packets else self._strange_bytes + len(data)
        if packets:
            self._heard_ns = arrival_ns
        frames = [self._frame(packet, arrival_ns) for packet in packets]
        return [frame for frame in frames if frame is not None]

    def _frame(self, packet: Packet, arrival_ns: int) -> Frame | None:
        fields_ut = np.array([each.field_ut if each.is_measured else NOTHING_UT for each in packet])
        fields_ut[~np.isfinite(fields_ut)] = np.nan
        stamp = self._clock.stamped(arrival_ns)
        if stamp is None:
            self._steps.hear(fields_ut)
            return None
        number, device_us, host_ns = stamp
        if self._clock.epochs != self._run:
            self._begin_run()
        before = self._steps.code
        counts, valid = self._steps.counts(fields_ut)
        if self._steps.code != before:
            self._tell_step()
        measured = np.array([reading.is_measured for reading in packet])
        valid &= measured
        # A packet repeats the last value of a chip that has nothing new.
        fresh = valid & (counts != self._values).any(axis=1)
        self._values = counts
        self._sampled_us[fresh] = device_us
        ages = np.where(valid, np.minimum(device_us - self._sampled_us, AGE_UNKNOWN_US), AGE_UNKNOWN_US)
        self._note_silent(measured)
        warm = [reading.temperature_c for reading in packet if reading.is_measured]
        return Frame(
            pad_index=0,
            sequence=number,
            device_time_us=device_us,
            host_time_ns=host_ns,
            gain_code=self._steps.code,
            counts=np.where(valid[:, None], counts, 0).astype(np.int16),
            age_us=ages.astype(np.uint16),
            fresh=fresh,
            valid=valid,
            temperature_c=sum(warm) / len(warm) if warm else None,
            run=self._run,
            chip=self._pad.chip,
        )

    def _begin_run(self) -> None:
        """Numbers and times restart."""
        self._run = self._clock.epochs
        self._values[:], self._sampled_us[:] = 0, 0
        rate_hz = round(self._clock.rate_hz or 0.0, 1)
        self.state.board.update(rate_hz=rate_hz, magnetometers=self._pad.sensors, self_test=False)
        note(self.state.warnings, "rate", self._other_rate())

    def _tell_step(self) -> None:
        code, chip = self._steps.code, self._pad.chip
        xy_ut, _, z_ut = (round(float(step) * 1e6, 3) for step in chip.step_t[code])
        self.state.board.update(step_xy_ut=xy_ut, step_z_ut=z_ut, range_xy_gauss=chip.ranges_gauss[code])
        unknown = (
            f"the board's values are multiples of no step of its published library: they are rounded to {xy_ut:g} µT "
            f"(z: {z_ut:g} µT); does other firmware run on it?"
        )
        note(self.state.warnings, "step", None if self._steps.is_known else unknown)

    def _note_silent(self, valid: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> None:
        for sensor, measured in enumerate(valid):
            self._unmeasured[sensor] = 0 if measured else self._unmeasured[sensor] + 1
            silent = self._unmeasured[sensor] >= SILENT_PACKETS
            sentence = f"sensor {sensor + 1} (of the stream) gives no measurement: check its wires"
            note(self.state.sensor_faults, (0, sensor), sentence if silent else None)

    def _judge(self, now_ns: int) -> None:
        """Connected, silent, or another stream than the configured one."""
        quiet_ns = now_ns - max(self._heard_ns, self._opened_ns)
        if quiet_ns >= SILENCE_NS:
            silent = f"the port is open but silent for {quiet_ns / 1e9:.1f} s: is the board powered?"
            reason = self._strange() if self._strange_bytes >= STRANGE_BYTES else silent
            if quiet_ns >= REOPEN_NS:
                self._disconnect(reason, now_ns)
            else:
                self.state.disconnect(reason, now_ns)
        elif self._clock.period_ns and not self.state.connected:
            self._backoff_ns = FIRST_BACKOFF_NS
            self.state.connect(now_ns)

    def _strange(self) -> str:
        form = "text" if self._pad.is_text else "binary packets"
        return (
            f"{self._strange_bytes} bytes and no packet: geometry.sensors_mm has {self._pad.sensors} magnetometers, "
            f"form is {form}, baud {self._pad.baud}: does the board send something else?"
        )

    def _other_rate(self) -> str | None:
        rate_hz = self._clock.rate_hz or 0.0
        if abs(rate_hz - self._pad.rate_hz) <= RATE_TOLERANCE * self._pad.rate_hz:
            return None
        return f"the board sends {rate_hz:.0f} packets a second: set rate_hz = {rate_hz:.0f}"

    def _disconnect(self, reason: str, now_ns: int) -> None:
        """Close the port first: while it is open, a board that is plugged in again gets another name."""
        self._release()
        self.state.disconnect(reason, now_ns)
        self._wait(now_ns)

    def _wait(self, now_ns: int) -> None:
        self._attempt_ns = now_ns + self._backoff_ns
        self._backoff_ns = min(2 * self._backoff_ns, LONGEST_BACKOFF_NS)

    def _release(self) -> None:
        if self._serial is not None:
            serial_port.close(self._serial)
            self._serial = self._descriptor = None
