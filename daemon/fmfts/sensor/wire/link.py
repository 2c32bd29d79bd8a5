"""The host's end of the wire protocol, over any carrier: turns bytes into frames and facts, settings into requests."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from fmfts.sensor.chips.selftest import no_selftest
from fmfts.sensor.early import EarlySample
from fmfts.sensor.frame import Frame
from fmfts.sensor.source import CannotError, SourceState
from fmfts.sensor.wire import faults
from fmfts.sensor.wire.admission import Admission, timed_together
from fmfts.sensor.wire.board import SETTING, Board
from fmfts.sensor.wire.clock import DeviceClock, HostClock
from fmfts.sensor.wire.framing import Decoder, PackedEarly
from fmfts.sensor.wire.line_guard import ASK_NS
from fmfts.sensor.wire.packets import (
    Early,
    Hello,
    Load,
    Packet,
    Reply,
    Request,
    Result,
    Sample,
    Selftest,
    Status,
    Verb,
)
from fmfts.sensor.wire.requests import REPEAT_NS, Requests
from fmfts.sensor.wire.selftests import Selftests
from fmfts.sensor.wire.strange import StrangeBytes
from fmfts.sensor.wired_pad import WiredPad

LOADS_KEPT = 240  # three seconds of load-cell readings, if nobody takes them
CLOCK_TOLERANCE = {0: 200e-6, 1: 200e-6, 2: 0.02}  # hello's `clock`: host build, crystal, RC oscillator


class Link:
    """Updates `state` from what arrives. `hello` is the board's last one, None before the first since `restart`.

    early: the samples that the last `feed` found before their frames, each with the number of the frame of that `feed`
    before which it came.
    """

    def __init__(
        self,
        pads: Mapping[int, WiredPad],
        state: SourceState,
        clock: DeviceClock | HostClock,
        uid: bytes | None = None,
    ) -> None:
        self.heard_ns = 0
        self.requests = Requests()
        self.early: list[tuple[int, EarlySample]] = []
        self.loads: deque[tuple[int, int]] = deque(maxlen=LOADS_KEPT)  # host time in ns, counts
        self._pads = pads
        self._state = state
        self._clock = clock
        self._board = Board(pads, state, uid)
        self._decoder = Decoder()
        self._hello_due_ns: int | None = None
        self.strange = StrangeBytes()
        self._selftests = Selftests()
        self._admission = Admission(pads, state, clock, self._board, self.requests)

    @property
    def hello(self) -> Hello | None:
        return self._board.hello

    @property
    def is_right_board(self) -> bool:
        return self._board.is_right

    def line_carries(self, bytes_per_s: float) -> None:
        """Set the rate of the link's carrier; by default it is unlimited."""
        self._board.line_bytes_per_s = bytes_per_s

    @property
    def is_quiet(self) -> bool:
        """`outgoing` has nothing to send, now or later."""
        return self._hello_due_ns is None and self.requests.due_ns is None and self._selftests.due_ns is None

    def accepts(self, pad_index: int) -> bool:
        """Samples of this pad came from the right board and agreed with its hello."""
        return self._decoder.has_joined and self._admission.has_taken(pad_index)

    def give_back(self) -> bytes:
        """Take out the beginning of a packet whose rest has not come yet: for `feed` later, or for another reader."""
        return self._decoder.give_back()

    @property
    def due_ns(self) -> int | None:
        """When `outgoing` next has something to send."""
        times = [self.requests.due_ns, self._hello_due_ns, self._selftests.due_ns]
        return min((time for time in times if time is not None), default=None)

    def restart(self) -> None:
        """The line was newly opened: forget everything about the old one."""
        self._board.forget()
        self.heard_ns, self._hello_due_ns = 0, None
        self._decoder = Decoder()
        self.strange.forget()
        self._clock.restart()
        self.requests.clear()
        self._admission.restart()

    def lost(self, reason: str) -> None:
        """The line is gone: drop the requests and fail the self-tests."""
        self.requests.clear()
        self._selftests.fail_all(reason)

    def outgoing(self, now_ns: int) -> bytes:
        """Bytes to send now."""
        self._review_line(now_ns)
        self._selftests.give_up(now_ns)
        if self._hello_due_ns is not None and now_ns >= self._hello_due_ns:
            self._hello_due_ns = None
            self.requests.ask(Verb.HELLO)
        data = self.requests.outgoing(now_ns)
        if self.requests.unheard and self.heard_ns:
            self._state.warnings["requests"] = faults.DEAF
        return data

    def feed(self, data: bytes, now_ns: int) -> list[Frame]:
        """Process the bytes that arrived. Returns the frames for the configured pads, only from the right board.
        Never raises: packets that contradict the board's hello are left out, counted, and named in `warnings`.
        """
        frames = self._feed(data, now_ns)
        return timed_together(frames, self._clock, now_ns) if len(frames) > 1 else frames

    def _feed(self, data: bytes, now_ns: int) -> list[Frame]:
        arrived = data
        self.early = []
        samples, data = self._decoder.leading_samples(data)
        frames: list[Frame] = []
        for sample in samples:
            if len(sample[4]) == 3:
                self._take_early(sample, len(frames), now_ns)
            elif (frame := self._admission.wire_frame(sample, now_ns)) is not None:
                frames.append(frame)
        if samples:
            self.heard_ns = now_ns
            self.strange.forget()
        if not data:
            return frames
        self.strange.add(arrived)
        before = (self._decoder.crc_errors, self._decoder.garbage_bytes)
        for packet in self._decoder.feed(data):
            self.heard_ns = now_ns
            self.strange.forget()
            if type(packet) is Sample:
                frame = self._admission.frame(packet, now_ns)
                if frame is not None:
                    frames.append(frame)
            elif type(packet) is Early:
                early = packet.pad_index, packet.sensor, packet.gain_code, packet.time_us, packet.counts
                self._take_early(early, len(frames), now_ns)
            else:
                self._take(packet, now_ns)
        self._state.crc_errors += self._decoder.crc_errors - before[0]
        self._state.garbage_bytes += self._decoder.garbage_bytes - before[1]
        if self._decoder.foreign_version is not None:
            self._state.warnings["wire version"] = faults.foreign_version(self._decoder.foreign_version)
        return frames

    def request_selftest(self, pad_index: int, now_ns: int) -> None:
        pad = self._pads[pad_index]
        if not pad.has_selftest:
            raise CannotError(f"pad {pad.name!r}: {no_selftest(pad.chip)}")
        self._selftests.begin(pad_index, pad.name, now_ns)
        self.requests.ask(Verb.SELFTEST, pad_index)

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return self._selftests.result(pad_index)

    def _take_early(self, packed: PackedEarly, before: int, now_ns: int) -> None:
        """before: how many frames this `feed` found before it."""
        if (early := self._admission.early(packed, now_ns)) is not None:
            self.early.append((before, early))

    def passed(self, pad_index: int, sequence: int) -> None:
        """Another reader handled frames of this pad, and this was the last one's number."""
        self._admission.guard.passed(pad_index, sequence)

    def _take(self, packet: Packet, now_ns: int) -> None:
        match packet:
            case Hello():
                self._admission.guard.hello(packet.uid, self._clock, now_ns)
                self._take_hello(packet)
                self._review_line(now_ns)
            case Status():
                self._take_status(packet)
            case Reply():
                self._take_reply(packet, now_ns)
            case Selftest():
                self._take_selftest(packet)
            case Load():
                taken_ns = self._admission.host_time_ns(packet.time_us, now_ns, Load, packet.sequence)
                if taken_ns is not None:
                    self.loads.append((taken_ns, packet.counts))
            case Request():
                self._admission.leave_out("request", "only a host sends these: are the board's TX and RX joined?")

    def _take_hello(self, hello: Hello) -> None:
        self._board.hello, self._hello_due_ns = hello, None
        self._admission.hello_came = True
        self._admission.forget_hello()
        if not self.is_right_board:
            return
        if isinstance(self._clock, DeviceClock):
            self._clock.tolerance = CLOCK_TOLERANCE.get(hello.clock, 0.02)
        self._board.describe()
        if (pads := self._board.pads_to_ask_for()) is not None:
            self.requests.ask(Verb.HELLO, argument=pads)  # settings follow with the hello of those pads
            return
        for verb, argument in self._board.wishes():
            self.requests.ask(verb, argument=argument)

    def _review_line(self, now_ns: int) -> None:
        """While several boards answer, take no samples, and ask again who is there."""
        was_crowded, crowd = self._admission.guard.crowd is not None, self._admission.guard.review(now_ns)
        if crowd is not None:
            self._admission.forget_hello()
            self._hello_due_ns = self._hello_due_ns or now_ns + ASK_NS
            self._state.pad_faults.update(dict.fromkeys(self._pads, crowd))
        elif was_crowded:
            self._board.describe()

    def _take_status(self, status: Status) -> None:
        self._board.count(status)
        for pad_index, pad in enumerate(status.pads):
            if self._admission.fits("status", pad_index, len(pad.states)):
                self._board.count_of_pad(pad_index, pad)

    def _take_selftest(self, selftest: Selftest) -> None:
        if self.hello is None or not self._selftests.awaits(selftest.pad_index):
            return  # the result of another program's request, or too late
        why = self._board.contradiction_of(selftest)
        if why is None:
            self._selftests.finish(selftest, self.hello.pads[selftest.pad_index], self._board.chip)
        else:
            self._admission.leave_out("self-test", why)
            self._selftests.fail(selftest.pad_index, f"the board's result cannot be: {why}")

    def _take_reply(self, reply: Reply, now_ns: int) -> None:
        request = self.requests.answered(reply)
        if request is None:
            return
        self._state.warnings.pop("requests", None)
        subject = f"request {Verb(request.verb).name.lower()}"
        refused = reply.result != Result.DONE
        if request.verb == Verb.HELLO or (reply.result == Result.BUSY and request.verb in SETTING):
            self._hello_due_ns = now_ns + REPEAT_NS  # in case the hello is lost; a hello renews the request
        if not refused and request.verb in SETTING:
            self._board.granted(Verb(request.verb), request.argument)
        if refused and request.verb == Verb.HELLO and request.argument and reply.result != Result.BUSY:
            self._board.cannot_make_pads()  # and reports it for the pads
            return
        faults.note(self._state.warnings, subject, faults.refusal(request, reply) if refused else None)
        if refused and request.verb == Verb.SELFTEST:
            self._selftests.fail(request.pad_index, faults.refusal(request, reply))
