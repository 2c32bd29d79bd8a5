"""When a hand counts as still, and what is said where a step cannot be taken."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fmfts.sensor.chips import DEFAULT_CHIP
from fmfts.sensor.frame import Frame
from fmfts_magnet.holding import Held, Hold

GAIN_CODE = 3
STEP_T = DEFAULT_CHIP.step_t[GAIN_CODE]
NOTHING = Held(np.zeros((4, 3)), np.full((4, 3), 1e-8))


def shown(hold: Hold, field_t: Callable[[float], float], is_asked: bool = False, seconds: float = 2.0) -> Hold:
    """Frames at 100 Hz of a field that all axes share. An infinite field gives the chip's saturated count."""
    random = np.random.default_rng(1)
    for number in range(round(seconds * 100)):
        value = field_t(number / 100)
        counts = np.full((4, 3), DEFAULT_CHIP.saturated_count)
        if np.isfinite(value):
            counts = np.rint((value + random.normal(0.0, 2e-7, (4, 3))) / STEP_T)
        every = np.ones(4, dtype=bool)
        age = np.zeros(4, dtype=np.uint16)
        time_us = number * 10_000
        frame = Frame(0, number, time_us, time_us * 1000, GAIN_CODE, counts.astype(np.int16), age, every, every, None)
        hold.take(frame, is_asked)
    return hold


def test_steady_hand_is_taken_with_its_mean() -> None:
    hold = shown(Hold(NOTHING), lambda _: 8e-5)
    assert hold.held is not None
    assert hold.held.mean_t == pytest.approx(np.full((4, 3), 8e-5), abs=2e-7)
    assert 1e-8 < hold.held.noise_t.max() < 6e-8  # 0.2 µT and the rounding, over a hundred samples


@pytest.mark.parametrize(
    ("field_t", "text"),
    [
        (lambda _: 1e-5, "too weak: 10 of at least 20 µT. Hold the magnet lower"),
        (lambda _: np.inf, "too strong: sensor 1 is saturated. Hold the magnet higher"),
        (lambda time_s: 8e-5 + 2e-5 * time_s, "hold still for a second"),
    ],
    ids=["weak", "saturated", "moving"],
)
def test_step_is_refused_with_what_to_do(field_t: Callable[[float], float], text: str) -> None:
    hold = shown(Hold(NOTHING), field_t)
    assert hold.held is None
    assert text in hold.hint


def test_enter_accepts_a_moving_hand() -> None:
    assert shown(Hold(NOTHING), lambda time_s: 8e-5 + 2e-5 * time_s, is_asked=True).held is not None


def test_same_place_is_not_a_new_step() -> None:
    last = Held(np.full((4, 3), 8e-5), NOTHING.noise_t)
    hold = shown(Hold(NOTHING, last), lambda _: 8.2e-5, is_asked=True)
    assert hold.held is None
    assert "move the magnet to the new place" in hold.hint


def test_sensor_that_was_always_saturated_stops_nobody() -> None:
    before = Held(np.full((4, 3), np.nan), NOTHING.noise_t)
    assert "no sensor measures" in shown(Hold(before), lambda _: np.inf).hint
