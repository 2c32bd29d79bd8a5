"""A board makes the configured pads, and none of its samples counts before that."""

from __future__ import annotations

import pytest
from test_link import Line, hello, pad, sample

from fmfts.config import BridgeSource, GeometryConfig, PadConfig
from fmfts.sensor.wire.board_pads import ASKED, NOT_SAID, BoardPads
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.link import Link
from fmfts.sensor.wire.packets import Hello, HelloPad, HelloSensor, Reply, Result, Verb
from fmfts.sources import on_board

HALVES = ((0x70, 0, 4), (0x70, 4, 4), (0x71, 0, 4))  # mux, first channel, sensors: as a board with twelve finds them
MADE = ((0x70, 0, 8), (0x71, 0, 4))


def told(*pads: tuple[int, int, int], **changes: object) -> Hello:
    described = tuple(
        HelloPad(1, mux, tuple(HelloSensor(first + i, 0, b"H43") for i in range(count))) for mux, first, count in pads
    )
    return hello(**({"pads": described, "can_make_pads": 1} | changes))


def line_of_eight() -> Line:
    return Line(pad("array", sensors=8), pad("left", pad_index=1))


def test_samples_count_once_the_board_has_the_configured_pads() -> None:
    line = line_of_eight()
    line.feed(told(*HALVES))
    asked = line.asked()
    assert [(one.verb, one.argument) for one in asked] == [(Verb.HELLO, 0x48)]
    assert line.state.pad_faults == {0: ASKED, 1: ASKED}
    # Pad 1 has as many sensors as the configured one, but is another pad.
    assert line.feed(sample(4, pad_index=0), sample(4, pad_index=1, time_us=9000)) == []
    line.feed(Reply(asked[0].request_id, Verb.HELLO, 0), told(*MADE))
    assert line.state.pad_faults == {}
    frames = line.feed(sample(8, time_us=13000), sample(4, pad_index=1, time_us=18000))
    assert [len(frame.counts) for frame in frames] == [8, 4]
    assert line.asked() == []


def test_settings_are_asked_for_after_the_pads() -> None:
    line = Line(pad("array", sensors=8, range_gauss=8.1))
    line.feed(told(*HALVES))
    first = line.asked()
    assert [one.verb for one in first] == [Verb.HELLO]
    line.feed(Reply(first[0].request_id, Verb.HELLO, 0))
    assert line.asked() == []
    line.feed(told(*MADE))
    assert [one.verb for one in line.asked()] == [Verb.RANGE]


def test_samples_before_hello_are_ignored() -> None:
    line = line_of_eight()
    assert line.feed(sample(4, pad_index=1)) == []
    assert line.state.pad_faults == {1: NOT_SAID}


def test_pads_of_four_are_requested_from_a_pad_of_eight() -> None:
    line = Line(pad("left"), pad("right", pad_index=1))
    line.feed(told(*MADE))
    assert [(one.verb, one.argument) for one in line.asked()] == [(Verb.HELLO, 0x44)]
    assert line.feed(sample(4, pad_index=1)) == []


def test_reset_with_a_lost_hello_stops_the_stream_until_a_hello() -> None:
    line = line_of_eight()
    line.feed(told(*MADE))
    assert len(line.feed(sample(4, pad_index=1, time_us=60_000_000))) == 1
    taken = []
    for number in range(40):  # its clock restarted, and pad 1 is now the other half of the mux
        taken += line.feed(sample(4, pad_index=1, sequence=number, time_us=1000 + 4545 * number))
    assert taken == []
    assert line.state.pad_faults[1] == NOT_SAID
    assert [one.verb for one in line.asked()] == [Verb.HELLO]
    line.feed(told(*HALVES))
    assert line.state.pad_faults == {0: ASKED, 1: ASKED}


def test_reset_with_hello_and_same_pads_costs_no_frame() -> None:
    line = line_of_eight()
    line.feed(told(*MADE))
    line.feed(sample(8, time_us=60_000_000))
    line.feed(told(*MADE))
    assert len(line.feed(sample(8, time_us=1000))) == 1


def test_older_firmware_is_named_and_its_small_pads_continue() -> None:
    line = Line(pad("left"), pad("array", sensors=8, pad_index=1), pad("right", pad_index=2))
    line.feed(told(*HALVES, can_make_pads=0))
    assert line.asked() == []
    sentence = (
        "pad_index = 1 has 8 sensors, and firmware 0.1.0 makes pads of 4: flash the firmware that came with this daemon"
    )
    assert line.state.pad_faults == {1: sentence, 2: sentence}
    assert len(line.feed(sample(4))) == 1
    assert line.feed(sample(4, pad_index=2, time_us=9000)) == []


def test_refused_pads_are_reported_and_not_requested_again() -> None:
    line = Line(pad("left"), pad("array", sensors=8, pad_index=1))
    line.feed(told(*HALVES))
    (asked,) = line.asked()
    line.feed(Reply(asked.request_id, Verb.HELLO, Result.OUT_OF_RANGE))
    assert line.state.pad_faults[1].startswith(
        "the board cannot make pad_index = 1 of 8 sensors: it has pad 0 on channels 0 to 3 of mux 0x70, pad 1 on "
        "channels 4 to 7 of mux 0x70, pad 2 on channels 0 to 3 of mux 0x71."
    )
    assert line.answer_all(told(*HALVES)) == [Verb.HELLO]
    assert 0 not in line.state.pad_faults
    assert len(line.feed(sample(4))) == 1
    line.feed(told((0x70, 0, 4), (0x71, 0, 4)))  # wired otherwise now
    assert [one.argument for one in line.asked()] == [0x84]


def test_busy_board_is_asked_again() -> None:
    line = line_of_eight()
    line.feed(told(*HALVES))
    (asked,) = line.asked()
    line.feed(Reply(asked.request_id, Verb.HELLO, Result.BUSY))
    assert line.asked(later_ns=100_000_000) == []
    (again,) = line.asked(later_ns=200_000_000)
    assert (again.verb, again.argument) == (Verb.HELLO, 0)
    line.feed(Reply(again.request_id, Verb.HELLO, 0), told(*HALVES))
    assert [one.argument for one in line.asked()] == [0x48]


def test_verb_that_opens_one_pad_knows_those_beside_it() -> None:
    array, left, elsewhere = (
        PadConfig(
            name=name, source=BridgeSource(port=port, pad_index=index), geometry=GeometryConfig(sensors_mm=places)
        )
        for name, port, index, places in (
            ("array", "/dev/null", 0, tuple((float(i), 0.0, 0.0) for i in range(8))),
            ("left", "/dev/null", 1, GeometryConfig().sensors_mm),
            ("elsewhere", "/dev/zero", 0, GeometryConfig().sensors_mm),
        )
    )
    line = Line()
    line.link = Link({1: on_board(left, [array, left, elsewhere])}, line.state, DeviceClock())
    line.feed(told(*HALVES))
    assert [one.argument for one in line.asked()] == [0x48]


@pytest.mark.parametrize("sensors", [{0: 4}, {1: 4}, {0: 4, 2: 4}])
def test_pads_as_they_are_found_need_no_request(sensors: dict[int, int]) -> None:
    assert BoardPads(sensors).request(told(*HALVES)) is None
    assert BoardPads(sensors).fault(told(*HALVES), 0) is None
