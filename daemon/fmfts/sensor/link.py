"""The host's end of the wire, whatever carries it: bytes become frames and facts, wishes become requests."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from msgspec.structs import replace

from fmfts.config import BridgeSource, I2cSource, PadConfig
from fmfts.sensor import faults, hmc5983
from fmfts.sensor.clock import DeviceClock, HostClock
from fmfts.sensor.frame import Frame
from fmfts.sensor.framing import Decoder, encode
from fmfts.sensor.packets import (
    ALL_PADS,
    TEMPERATURE_UNKNOWN,
    Hello,
    Packet,
    Reply,
    Request,
    Result,
    Sample,
    Selftest,
    Status,
    Verb,
)
from fmfts.sensor.selftests import Selftests
from fmfts.sensor.source import SourceError, SourceState

REPEAT_NS = 250_000_000
DEAF_AFTER = 8  # sendings of one request
CLOCK_TOLERANCE = {0: 200e-6, 1: 200e-6, 2: 0.02}  # hello's `clock`: host build, crystal, RC oscillator
_SETTING = {Verb.RANGE: "gain_code", Verb.RATE: "rate_hz", Verb.TRIGGER: "trigger"}  # what of hello a request changes
_BITS_OF_MASK = (np.arange(256)[:, None] >> np.arange(8) & 1).astype(bool)
_BITS_OF_MASK.setflags(write=False)


@dataclass(frozen=True, slots=True)
class Settings:
    """What a config asks of a board."""

    gain_code: int
    rate_hz: int
    trigger: int

    @classmethod
    def of(cls, pad: PadConfig) -> Self:
        """SourceError where no chip can do what the config asks."""
        source = pad.source
        assert isinstance(source, BridgeSource | I2cSource)
        most_hz = hmc5983.highest_rate_hz(source.chip, source.trigger)
        if source.rate_hz > most_hz:
            asked = f"rate_hz = {source.rate_hz}, chip = {source.chip!r}, trigger = {source.trigger!r}"
            raise SourceError(f"pad {pad.name!r}: {asked}: at most {most_hz} Hz are possible; lower rate_hz")
        try:
            gain_code = hmc5983.gain_code_for_range(source.range_gauss)
        except ValueError as error:
            raise SourceError(f"pad {pad.name!r}: range_gauss: {error}") from None
        return cls(gain_code, source.rate_hz, int(source.trigger == "simultaneous"))


class Link:
    """Keeps `state` true to what arrives; `hello` is the board's last, None until it has spoken since `restart`."""

    def __init__(
        self,
        pads: Mapping[int, PadConfig],
        state: SourceState,
        clock: DeviceClock | HostClock,
        uid: bytes | None = None,
    ) -> None:
        self.hello: Hello | None = None
        self.heard_ns = 0
        self._pads = pads
        self._settings = Settings.of(next(iter(pads.values())))
        self._state = state
        self._clock = clock
        self._uid = uid
        self._decoder = Decoder()
        self._expected: dict[int, int] = {}
        self._queue: deque[Request] = deque()
        self._repeat_ns = 0
        self._sendings = 0
        self._next_id = 0
        self._selftests = Selftests()

    @property
    def is_right_board(self) -> bool:
        """False while a binding is configured and not yet confirmed."""
        return self._uid is None or (self.hello is not None and self.hello.uid == self._uid)

    @property
    def due_ns(self) -> int | None:
        """When `outgoing` has something to say."""
        times = [self._repeat_ns if self._queue else None, self._selftests.due_ns]
        return min((time for time in times if time is not None), default=None)

    def restart(self) -> None:
        """A newly opened line: nothing of the old one holds. Frames missed meanwhile are no gap but a reconnect."""
        self.hello = None
        self.heard_ns = 0
        self._decoder = Decoder()
        self._clock.restart()
        self._expected.clear()
        self._queue.clear()
        self._state.board.clear()
        self._state.sensor_faults.clear()

    def lost(self, reason: str) -> None:
        """The line is gone: so is what was asked over it."""
        self._queue.clear()
        self._selftests.fail_all(reason)

    def ask(self, verb: Verb, pad_index: int = ALL_PADS, argument: int = 0) -> None:
        """Queue a request; one is on its way at a time, in the order asked."""
        if not self._queue:
            self._repeat_ns = 0
        self._queue.append(Request(verb, self._next_id, pad_index, argument))
        self._next_id = (self._next_id + 1) % 256

    def outgoing(self, now_ns: int) -> bytes:
        """Bytes to send now: the request on its way, again after 250 ms; the zero before it ends what was torn."""
        self._selftests.give_up(now_ns)
        if not self._queue or now_ns < self._repeat_ns:
            return b""
        self._repeat_ns = now_ns + REPEAT_NS
        self._sendings += 1
        if self._sendings > DEAF_AFTER and self.heard_ns:
            self._state.warnings["requests"] = (
                "the board sends but answers no request: check the line from host to board"
            )
        return b"\0" + encode(self._queue[0])

    def feed(self, data: bytes, now_ns: int) -> list[Frame]:
        """Take in what arrived; the frames in it, for the pads of the config and only from the right board."""
        frames = []
        before = self._counted()
        for packet in self._decoder.feed(data):
            self.heard_ns = now_ns
            if type(packet) is Sample:
                frame = self._frame(packet, now_ns)
                if frame is not None:
                    frames.append(frame)
            else:
                self._take(packet)
        self._count(before)
        return frames

    def request_selftest(self, pad_index: int, now_ns: int) -> None:
        self._selftests.begin(pad_index, self._pads[pad_index].name, now_ns)
        self.ask(Verb.SELFTEST, pad_index)

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return self._selftests.result(pad_index)

    def _counted(self) -> tuple[int, int, int]:
        return self._decoder.crc_errors, self._decoder.garbage_bytes, self._decoder.foreign_packets

    def _count(self, before: tuple[int, int, int]) -> None:
        after = self._counted()
        if after == before:
            return
        state = self._state
        state.crc_errors += after[0] - before[0]
        state.garbage_bytes += after[1] - before[1]
        state.foreign_packets += after[2] - before[2]
        if after[2] > before[2]:
            state.warnings["wire version"] = faults.foreign_version(self._decoder.foreign_version)

    def _frame(self, sample: Sample, now_ns: int) -> Frame | None:
        host_time_ns = self._clock.to_host_ns(sample.time_us, now_ns)
        pad = self._pads.get(sample.pad_index)
        if pad is None or not self.is_right_board:
            return None
        sensors = len(sample.counts)
        if sensors != len(pad.geometry.sensors_mm):
            self._state.warnings[pad.name] = faults.wrong_sensor_count(pad, sensors)
            return None
        self._count_gap(sample)
        return Frame(
            sample.pad_index,
            sample.sequence,
            sample.time_us,
            host_time_ns,
            sample.gain_code,
            sample.counts,
            sample.age_us,
            _BITS_OF_MASK[sample.fresh, :sensors],
            _BITS_OF_MASK[sample.valid, :sensors],
            None if sample.temperature_raw == TEMPERATURE_UNKNOWN else hmc5983.temperature_c(sample.temperature_raw),
        )

    def _count_gap(self, sample: Sample) -> None:
        expected = self._expected.get(sample.pad_index, sample.sequence)
        if sample.sequence > expected:  # a smaller number is a reset
            gaps = self._state.gaps
            gaps[sample.pad_index] = gaps.get(sample.pad_index, 0) + sample.sequence - expected
        self._expected[sample.pad_index] = (sample.sequence + 1) % 2**32

    def _take(self, packet: Packet) -> None:
        match packet:
            case Hello():
                self._take_hello(packet)
            case Status():
                self._state.board["transmit_dropped"] = packet.transmit_dropped
                self._state.board["receive_errors"] = packet.receive_errors
                for pad_index, pad in enumerate(packet.pads):
                    counters = {
                        "errors": pad.bus_errors,
                        "recoveries": pad.bus_recoveries,
                        "repairs": pad.config_repairs,
                    }
                    self._state.board[f"bus_{pad_index}"] = counters
                    self._note_sensors(pad_index, pad.states)
            case Reply():
                self._take_reply(packet)
            case Selftest():
                if self.hello is not None and packet.pad_index < len(self.hello.pads):
                    self._selftests.finish(packet, self.hello)

    def _take_hello(self, hello: Hello) -> None:
        self.hello = hello
        if not self.is_right_board:
            return
        self._state.board.update(faults.identity(hello))
        if isinstance(self._clock, DeviceClock):
            self._clock.tolerance = CLOCK_TOLERANCE.get(hello.clock, 0.02)
        faults.note(self._state.warnings, "clock", faults.bad_clock(hello))
        for pad_index, pad in self._pads.items():
            faults.note(self._state.warnings, pad.name, faults.pad_mismatch(pad, pad_index, hello))
        for pad_index, described in enumerate(hello.pads):
            self._note_sensors(pad_index, tuple(sensor.state for sensor in described.sensors))
        self._configure(hello)

    def _configure(self, hello: Hello) -> None:
        wanted = self._settings
        if hello.gain_code != wanted.gain_code:
            self.ask(Verb.RANGE, argument=wanted.gain_code)
        # In this order no rate is ever asked for that the trigger in force cannot do.
        changes = [(Verb.TRIGGER, hello.trigger, wanted.trigger), (Verb.RATE, hello.rate_hz, wanted.rate_hz)]
        for verb, actual, value in reversed(changes) if wanted.trigger else changes:
            if actual != value:
                self.ask(verb, argument=value)
        if not hello.running:
            self.ask(Verb.START)

    def _note_sensors(self, pad_index: int, states: tuple[int, ...]) -> None:
        if pad_index not in self._pads or self.hello is None or pad_index >= len(self.hello.pads):
            return
        for sensor, state in enumerate(states):
            sentence = faults.sensor_fault(self.hello.pads[pad_index], sensor, state)
            faults.note(self._state.sensor_faults, (pad_index, sensor), sentence)

    def _take_reply(self, reply: Reply) -> None:
        if not self._queue or self._queue[0].request_id != reply.request_id:
            return  # the answer to an earlier sending of what was answered already
        request = self._queue.popleft()
        self._repeat_ns = self._sendings = 0
        self._state.warnings.pop("requests", None)
        subject = f"request {Verb(request.verb).name.lower()}"
        refused = reply.result != Result.DONE
        if not refused and request.verb in _SETTING and self.hello is not None:
            self.hello = replace(self.hello, **{_SETTING[Verb(request.verb)]: request.argument})
            self._state.board.update(faults.identity(self.hello))
        faults.note(self._state.warnings, subject, faults.refusal(request, reply) if refused else None)
        if refused and request.verb == Verb.SELFTEST:
            self._selftests.fail(request.pad_index, faults.refusal(request, reply))
