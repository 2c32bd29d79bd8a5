"""When fingers that explain a frame are told as good."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.several.reading import FingersMemory, FingersReading
from fmfts.several.recovery import Recovery
from fmfts.several.trust import SETTLED_FRAMES, trusted
from fmfts_lab.bench.several_world import EXACT, Press, read_once, world


@pytest.fixture(scope="module")
def pressed() -> FingersReading:
    one = world(1, EXACT)
    return read_once(one, one.pressed([Press(3.0, -4.0, 1.0)]))


@pytest.fixture
def memory() -> FingersMemory:
    return FingersMemory(Recovery(np.zeros(24)))


def test_fingers_are_trusted_again_after_ten_frames_explained(pressed: FingersReading, memory: FingersMemory) -> None:
    """A broken magnet lets two fingers explain each second frame, each time others."""
    assert trusted(pressed, memory, has_jumped=False) is pressed
    unexplained = FingersReading("disturbed", "", pressed.used)
    for _ in range(3):
        assert trusted(unexplained, memory, has_jumped=False) is unexplained
        assert trusted(pressed, memory, has_jumped=False).health == "degraded"
    said = [trusted(pressed, memory, has_jumped=False) for _ in range(SETTLED_FRAMES)]
    assert [one.health for one in said] == ["degraded"] * (SETTLED_FRAMES - 1) + ["ok"]
    assert "nothing explained the field a moment ago" in said[0].reason


def test_fingers_in_a_frame_that_jumps_are_not_trusted(pressed: FingersReading, memory: FingersMemory) -> None:
    jumping = trusted(pressed, memory, has_jumped=True)
    assert (jumping.health, jumping.fit) == ("degraded", pressed.fit)
    assert "jumped" in jumping.reason
    untouched = FingersReading("ok", "", pressed.used)
    assert trusted(untouched, memory, has_jumped=True) is untouched
