"""The host's end of the wire against boards that say what cannot be, and lines that lose what matters."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wire_packets import make_early, make_sample, packets, samples, selftests

from fmfts.config import BridgeSource, GeometryConfig, PadConfig
from fmfts.runtime.statistics import PadStatistics
from fmfts.sensor import Source
from fmfts.sensor.probing import faults_of
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.link import Link
from fmfts.sensor.wire.packets import (
    MAX_SENSORS,
    Hello,
    HelloPad,
    HelloSensor,
    Packet,
    Reply,
    Request,
    Sample,
    Selftest,
    SelftestSensor,
    Status,
    StatusPad,
    Verb,
)
from fmfts.sensor.wired_pad import PadOnBoard
from fmfts.sources import on_board

UID = bytes(range(12))
SECOND_NS = 1_000_000_000
GOOD = SelftestSensor(0, (452, 452, 421), (-452, -452, -421))


def pad(name: str = "left", sensors: int = 4, **source: object) -> PadOnBoard:
    positions = tuple((float(i), 0.0, 0.0) for i in range(sensors))
    settings = BridgeSource(port="/dev/null", **source)  # type: ignore[arg-type]
    return on_board(PadConfig(name=name, source=settings, geometry=GeometryConfig(sensors_mm=positions)))


def hello(*sensors: int, identification: bytes = b"H43", **changes: object) -> Hello:
    """The hello of a board with this many sensors on each pad, set up as configured."""
    pads = tuple(
        HelloPad(1, 0x70 + i, tuple(HelloSensor(c, 0, identification) for c in range(n))) for i, n in enumerate(sensors)
    )
    fields = {"firmware_version": (0, 1, 0), "reset_cause": 1, "clock": 1, "uid": UID, "rate_hz": 220, "gain_code": 3}
    return Hello(**(fields | {"trigger": 0, "running": 1, "pads": pads} | changes))  # type: ignore[arg-type]


def sample(sensors: int = 4, pad_index: int = 0, **changes: int) -> Sample:
    everyone = (1 << sensors) - 1
    fields = {"sequence": 0, "time_us": 4545, "gain_code": 3, "trigger": 0, "valid": everyone, "fresh": everyone}
    fields["temperature_raw"] = 0
    return make_sample([(1, 2, 3)] * sensors, [0] * sensors, pad_index=pad_index, **(fields | changes))


def run_of(numbers: Iterable[int]) -> list[Sample]:
    """Samples with these sequence numbers, of a board whose clock counts from its start as they do."""
    return [sample(sequence=number, time_us=(number + 1) * 4545) for number in numbers]


class Line:
    """A Link, and the time at which things happen to it."""

    def __init__(self, *pads: PadConfig) -> None:
        self.state = SourceState(description="a board")
        self.link = Link(dict(enumerate(pads or (pad(),))), self.state, DeviceClock())
        self.link.restart()
        self.now_ns = SECOND_NS

    def feed(self, *packets_: Packet, later_ns: int = 4_545_000) -> list:
        self.now_ns += later_ns
        return self.link.feed(b"\0" + b"".join(encode(one) for one in packets_), self.now_ns)

    def asked(self, later_ns: int = 0) -> list[Request]:
        self.now_ns += later_ns
        return [one for one in Decoder().feed(self.link.outgoing(self.now_ns)) if isinstance(one, Request)]

    def answer_all(self, told: Hello) -> list[Verb]:
        """Answer all requests until none is left; each is done, and `told` is the hello."""
        answered: list[Verb] = []
        while asked := self.asked(later_ns=300_000_000):
            assert len(answered) < 10
            answered.append(Verb(asked[0].verb))
            self.feed(Reply(asked[0].request_id, asked[0].verb, 0), *([told] if answered[-1] == Verb.HELLO else []))
        return answered


@given(st.lists(st.tuples(packets, st.integers(0, 10 * SECOND_NS)), max_size=12), st.booleans(), st.booleans())
def test_no_packet_ever_raises_whatever_its_fields(sent: list[tuple[Packet, int]], known: bool, testing: bool) -> None:
    line = Line(pad(), pad("right", sensors=3))
    if known:
        line.feed(hello(4, 3))
    for packet, later_ns in sent:
        if testing:
            line.link.request_selftest(0, line.now_ns)
            testing = False
        for frame in line.feed(packet, later_ns=later_ns):
            assert frame.counts.shape == ((4, 3), (3, 3))[frame.pad_index]
            assert frame.host_time_ns <= line.now_ns
        line.link.outgoing(line.now_ns)
    assert all(0 <= sensor < MAX_SENSORS for _, sensor in line.state.sensor_faults)
    result = line.link.selftest_result(0)
    assert result is None or "passed" in result


@given(samples())
def test_sample_that_contradicts_hello_is_no_frame_and_is_named(packet: Sample) -> None:
    line = Line()
    line.feed(hello(4))
    frames = line.feed(packet)
    fits = packet.pad_index == 0 and len(packet.counts) == 4
    assert len(frames) == fits
    assert ("packets" in line.state.warnings) != fits


def test_misfit_packets_are_counted_and_the_last_is_named() -> None:
    line = Line()
    line.feed(hello(4))
    assert line.feed(sample(3), sample(5), Status(0, 0, 0, (StatusPad(0, 0, 0, (1,) * 6),))) == []
    assert line.state.warnings["packets"] == (
        "3 packets left out, the last a status: it has 6 sensors, and the hello has 4; "
        "if this goes on, flash the firmware again"
    )
    assert line.state.sensor_faults == {}
    line.feed(Request(Verb.HELLO, 0, 255, 0))
    assert "4 packets left out, the last a request: only a host sends these" in line.state.warnings["packets"]
    line.link.restart()
    assert line.state.warnings == {}


def test_sample_with_too_few_sensors_is_a_fault_until_one_fits() -> None:
    line = Line()
    assert line.feed(sample(3)) == []
    assert line.state.pad_faults == {
        0: "pad 'left': the source has 3 sensors, geometry.sensors_mm has 4: correct the config"
    }
    assert len(line.feed(sample(4, time_us=9090))) == 1
    assert line.state.pad_faults == {}


@given(selftests)
def test_any_result_ends_a_selftest_but_only_a_possible_one_is_judged(packet: Selftest) -> None:
    line = Line()
    line.feed(hello(4))
    line.link.request_selftest(0, line.now_ns)
    line.feed(packet)
    result = line.link.selftest_result(0)
    if packet.pad_index:
        assert result is None
    elif len(packet.sensors) == 4 and packet.gain_code < 8:
        assert result is not None
        assert len(result["sensors"]) == 4  # type: ignore[arg-type]
    else:
        assert result is not None
        assert result["passed"] is False
        assert "cannot be" in str(result["error"])


@pytest.mark.parametrize(("late_s", "is_taken"), [(15.0, True), (20.5, False)])
def test_selftest_waits_for_a_busy_computer_and_not_for_ever(late_s: float, is_taken: bool) -> None:
    line = Line()
    line.feed(hello(4))
    line.link.request_selftest(0, line.now_ns)
    line.now_ns += round(late_s * SECOND_NS)
    line.link.outgoing(line.now_ns)
    line.feed(Selftest(7, 0, 5, (GOOD,) * 4))
    result = line.link.selftest_result(0)
    assert result is not None
    if is_taken:
        assert result["passed"] is True
    else:
        assert str(result["error"]).startswith("no result within 20 s: ")


@pytest.mark.parametrize(
    ("sensors", "gain_code", "why"),
    [(5, 5, "it has 5 sensors, and the hello has 4"), (4, 8, "there is no gain code 8"), (4, 255, "no gain code 255")],
)
def test_impossible_selftest_result_fails_selftest_with_reason(sensors: int, gain_code: int, why: str) -> None:
    line = Line()
    line.feed(hello(4))
    line.link.request_selftest(0, line.now_ns)
    line.feed(Selftest(0, 0, gain_code, (GOOD,) * sensors))
    result = line.link.selftest_result(0)
    assert result is not None
    assert result["passed"] is False
    assert why in str(result["error"])
    assert "1 packet left out, the last a self-test" in line.state.warnings["packets"]


def test_selftest_result_that_nobody_awaits_changes_nothing() -> None:
    line = Line()
    line.feed(hello(4), Selftest(7, 0, 5, (GOOD,) * 4))
    assert line.link.selftest_result(0) is None


def test_lost_hello_is_asked_for_again() -> None:
    line = Line(pad(rate_hz=50))
    line.link.requests.ask(Verb.HELLO)
    (first,) = line.asked()
    line.feed(Reply(first.request_id, Verb.HELLO, 0), sample())
    assert line.asked() == []
    due_ns = line.link.due_ns
    assert due_ns is not None
    assert [one.verb for one in line.asked(later_ns=due_ns - line.now_ns)] == [Verb.HELLO]
    assert line.answer_all(hello(4)) == [Verb.HELLO, Verb.RATE]


def test_reset_whose_hello_was_lost_is_noticed_and_settings_given_again() -> None:
    line = Line(pad(rate_hz=50))
    line.feed(hello(4, rate_hz=50))
    for i in range(100):
        line.feed(sample(time_us=20_000 * i, sequence=i), later_ns=20_000_000)
    assert line.asked() == []
    for i in range(3):
        line.feed(sample(time_us=20_000 * i, sequence=i), later_ns=20_000_000)
    assert [one.verb for one in line.asked()] == [Verb.HELLO]
    assert line.answer_all(hello(4, rate_hz=220)) == [Verb.HELLO, Verb.RATE]


def test_busy_board_is_asked_again_and_a_refusal_is_not_repeated() -> None:
    line = Line(pad(rate_hz=50))
    line.feed(hello(4))
    (rate,) = line.asked()
    line.feed(Reply(rate.request_id, Verb.RATE, 4))
    assert [one.verb for one in line.asked(later_ns=300_000_000)] == [Verb.HELLO]
    line = Line(pad(rate_hz=50))
    line.feed(hello(4))
    (rate,) = line.asked()
    line.feed(Reply(rate.request_id, Verb.RATE, 2))
    assert line.asked(later_ns=300_000_000) == []
    assert "out of range" in line.state.warnings["request rate"]


def test_capable_board_is_asked_for_early_samples_after_each_hello() -> None:
    line = Line(pad(publish="sample"), pad("right", pad_index=1))
    line.feed(hello(4, 4, can_send_early=1))
    (start,) = line.asked()
    assert (start.verb, start.argument) == (Verb.START, 0b01)
    line.feed(Reply(start.request_id, Verb.START, 0), hello(4, 4, can_send_early=1))
    assert [one.verb for one in line.asked()] == [Verb.START]
    assert line.state.warnings == {}


def test_early_samples_are_not_requested_in_frame_mode() -> None:
    line = Line()
    line.feed(hello(4, can_send_early=1))
    assert line.asked() == []


def test_early_samples_requested_by_another_host_are_ignored() -> None:
    line = Line()
    line.feed(hello(4, can_send_early=1), sample(time_us=4545), make_early(2, 8000))
    assert line.link.early == []
    assert line.state.warnings == {}


def test_firmware_that_sends_frames_only_is_named_and_its_frames_are_used() -> None:
    line = Line(pad(publish="sample"))
    line.feed(hello(4))
    assert line.asked() == []
    assert len(line.feed(sample())) == 1
    assert line.state.warnings == {
        "early": 'firmware 0.1.0 sends frames only, so publish = "sample" is as "frame": flash the firmware that came '
        "with this daemon"
    }
    line.feed(hello(4, can_send_early=1))
    assert line.state.warnings == {}


@pytest.mark.parametrize(
    ("pads", "of_samples", "rate_hz", "fits"),
    [
        (1, 1, 220, True),
        (2, 1, 220, True),
        (2, 2, 220, False),
        (3, 1, 220, False),
        (3, 0, 220, True),
        (3, 1, 150, True),
    ],
)
def test_line_that_cannot_carry_early_samples_is_not_asked_to(
    pads: int, of_samples: int, rate_hz: int, fits: bool
) -> None:
    """460800 baud carry 46 kB/s: a pad's frames take 11.7 of them at 220 Hz, its early samples 17.2."""
    names = ("left", "right", "third")
    line = Line(
        *(pad(names[n], pad_index=n, rate_hz=rate_hz, publish=("frame", "sample")[n < of_samples]) for n in range(pads))
    )
    line.link.line_carries(46_080)
    line.feed(hello(*[4] * pads, can_send_early=1, rate_hz=rate_hz))
    assert [one.verb for one in line.asked()] == [Verb.START] * (fits and of_samples > 0)
    assert ("early" in line.state.warnings) is not fits
    if not fits:
        assert "kB/s, and the line carries 46.1" in line.state.warnings["early"]


def test_early_samples_come_before_the_frames_that_follow_them() -> None:
    line = Line(pad(publish="sample"))
    line.feed(hello(4, can_send_early=1), sample(time_us=4545))
    frames = line.feed(make_early(2, 8000), sample(time_us=9090, sequence=1), make_early(0, 9200), make_early(1, 9300))
    assert [frame.sequence for frame in frames] == [1]
    assert [(before, one.sensor, one.device_time_us, one.counts) for before, one in line.link.early] == [
        (0, 2, 8000, (1, 2, 3)),
        (1, 0, 9200, (1, 2, 3)),
        (1, 1, 9300, (1, 2, 3)),
    ]
    assert len(line.feed(sample(time_us=13635, sequence=2))) == 1
    assert line.link.early == []


def test_impossible_early_sample_is_ignored() -> None:
    line = Line(pad(publish="sample"))
    line.feed(hello(4, can_send_early=1), sample(time_us=4545))
    line.feed(make_early(5, 9000))
    assert line.link.early == []
    assert "it has" not in line.state.warnings["packets"]
    assert "the pad has no sensor 5" in line.state.warnings["packets"]
    line.feed(make_early(1, 9000, pad_index=2), make_early(1, 2**47))  # of no pad; with a time that no clock reached
    assert line.link.early == []


def test_board_that_resets_in_a_loop_does_not_fill_the_queue() -> None:
    line = Line(pad(rate_hz=50, trigger="simultaneous", range_gauss=4.0))
    for _ in range(1000):
        line.feed(hello(4))
    assert line.answer_all(hello(4)) == [Verb.RANGE, Verb.RATE, Verb.TRIGGER]


@pytest.mark.parametrize(
    ("version", "mend"), [(2, "update the daemon"), (0, "flash the firmware that came with this daemon")]
)
def test_another_wire_version_is_named_with_what_to_do(version: int, mend: str) -> None:
    from binascii import crc_hqx

    line = Line()
    body = bytes((version << 4 | 1, 7, 7, 7))
    packet = body + crc_hqx(body, 0xFFFF).to_bytes(2, "little")
    assert 0 not in packet[1:]
    stuffed = b"".join(bytes((len(block) + 1,)) + block for block in packet.split(b"\0"))
    assert line.link.feed(b"\0" + stuffed + b"\0", line.now_ns) == []
    said = f"the board speaks wire version {version}, this daemon 1: {mend}"
    assert line.state.warnings == {"wire version": said}


def test_missing_pad_is_no_fault_of_another_pad() -> None:
    line = Line(pad(), pad("right", pad_index=1))
    line.feed(hello(4, clock=2))
    source = cast("Source", SimpleNamespace(state=line.state))
    lacking = "the board has 1 pad, pad 'right' wants pad_index = 1 (they count from 0): correct the config"
    first, oscillator = faults_of(source, 1)
    assert first == lacking
    assert faults_of(source, 0) == [oscillator]


def test_new_hello_forgets_the_faults_of_sensors_that_are_gone() -> None:
    line = Line()
    line.feed(hello(4))
    line.feed(Status(0, 0, 0, (StatusPad(0, 0, 0, (0, 0, 0, 1)),)))
    assert set(line.state.sensor_faults) == {(0, 3)}
    line.feed(hello(3))
    assert line.state.sensor_faults == {}
    assert np.array_equal(list(line.state.pad_faults), [0])


@pytest.mark.parametrize("reopened", [True, False], ids=["plugged in again", "reset on an open line"])
@pytest.mark.parametrize("before", [100, 1000])
def test_frames_between_two_runs_of_a_board_are_no_gap(before: int, reopened: bool) -> None:
    line, statistics = Line(), PadStatistics()
    later = [*range(250, 300), *range(303, 310)]
    if not reopened and before == 100:
        later = [number - 200 for number in later]  # a board that was silent for longer than it ran has been reopened
    for numbers in (range(before), later):
        for one in run_of(numbers):
            for frame in line.feed(one):
                statistics.frame(frame)
        if reopened:
            line.link.restart()
        else:
            line.feed(hello(4))
    assert (statistics.frames, statistics.gaps) == (before + 57, 3)


def test_two_boards_on_one_line_are_both_rejected() -> None:
    line = Line()
    line.feed(hello(4))
    assert len(line.feed(sample(sequence=0, time_us=4545))) == 1
    other = hello(4, uid=bytes(range(50, 62)))
    line.feed(other)
    assert line.feed(sample(sequence=1, time_us=9090), sample(sequence=90, time_us=9991)) == []
    assert all(uid.hex() in line.state.pad_faults[0] for uid in (UID, other.uid))
    assert not line.link.accepts(0)
    for number in range(2, 14):  # the link asks every second, and one board answers
        asked = line.asked(later_ns=400_000_000)
        if asked:
            line.feed(Reply(asked[0].request_id, asked[0].verb, 0), hello(4))
        frames = line.feed(sample(sequence=number, time_us=(number + 1) * 4545 + number * 400_000))
    assert line.state.pad_faults == {}
    assert frames


def test_packets_of_another_board_make_it_ask_who_is_there() -> None:
    """Its hello was lost. Its clock is another, so its times do not go on."""
    line = Line()
    line.feed(hello(4))
    for number in range(300):
        line.feed(sample(sequence=number, time_us=(number + 1) * 4545))
    assert line.asked() == []
    assert line.feed(sample(sequence=7, time_us=77_000_000)) == []
    (request,) = line.asked()
    assert request.verb == Verb.HELLO
