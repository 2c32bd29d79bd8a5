"""The record of which C makes a message of several magnets: whoever fills it, C refuses what no pad can find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_now_of_several import frames, ready

from fmfts.common.record import Record
from fmfts.pipeline import _pad
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts_simulation.finger import steady_finger

LEFT, RIGHT = steady_finger(-6e-3, -1e-3, 0.8), steady_finger(7e-3, 3e-3, 0.7)
TOLD = "ok", "", 25.0


@pytest.fixture
def pressed() -> SeveralPipeline:
    made = ready()
    for frame in frames(20, LEFT):
        made.process(frame)
    return made


@pytest.mark.parametrize("count", [-1, 3])
def test_record_of_impossible_count_of_fingers_is_refused(pressed: SeveralPipeline, count: int) -> None:
    pressed._frames.found.put("count", count)
    with pytest.raises(ValueError, match=f"{count} fingers, at most 2"):
        pressed._frames.compiled.tell(*TOLD, None)


def test_record_of_another_size_is_refused(pressed: SeveralPipeline) -> None:
    with pytest.raises(ValueError, match="what is found ahead"):
        pressed._frames.compiled.tell(*TOLD, pressed._frames.found.buffer[8:])
    with pytest.raises(ValueError, match="doubles expected"):
        pressed._frames.compiled.bind(pressed._frames.bound[0], pressed._frames.found.buffer[8:], ())


def test_pad_that_is_bound_to_nothing_is_refused(pressed: SeveralPipeline) -> None:
    compiled = pressed._frames.compiled
    pressed._frames.bind()
    with pytest.raises(ValueError, match="bind this Pad to a model first"):
        compiled.follow_early(0, 0, 0, 0, 0, 10, None)
    with pytest.raises(ValueError, match="doubles expected"):
        compiled.bind(pressed._frames.bound[0], bytearray(8), ())
    with pytest.raises(ValueError, match="bind this Pad first"):
        compiled.tell(*TOLD, None)


def test_finger_at_no_finite_place_is_refused(pressed: SeveralPipeline) -> None:
    pressed._frames.found.put("fingers", np.full(3, np.nan))
    assert pressed._followed is not None
    pressed._followed.forget()  # else it goes on from where it was
    with pytest.raises(ValueError, match="at no finite place"):
        pressed._frames.compiled.tell(*TOLD, None)


def test_silent_sensor_is_used_in_no_message_of_a_closer_look() -> None:
    made = ready()
    for frame in frames(20, LEFT, RIGHT):
        last = made.process(replace(frame, valid=frame.valid & (np.arange(8) != 2)))
    assert last.sensors_ok == 0xFB
    assert made._frames.found["used"][:9].tolist() == [1] * 6 + [0] * 3


def test_record_of_what_c_found_says_the_same_when_told_by_python(pressed: SeveralPipeline) -> None:
    """A calm frame's record makes the same message again."""
    before = pressed._frames.compiled.last
    payload, has_now = pressed._frames.compiled.tell(*TOLD, None)
    assert has_now
    assert payload
    assert before is not None
    assert pressed._frames.compiled.last is not None
    assert pressed._frames.compiled.last[:4] == before[:4]


def test_nothing_is_found_ahead_of_a_finger(pressed: SeveralPipeline) -> None:
    """What its newest samples show counts only of an untouched frame."""
    empty = Record(_pad.FOUND)
    empty.put("fingers", np.full(3, np.nan))
    assert pressed._frames.compiled.tell(*TOLD, empty.buffer)[1]
