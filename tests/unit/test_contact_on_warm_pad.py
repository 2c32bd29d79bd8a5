"""Contacts on warm pads whose offsets drift by 30 nT/K: noise on top of that drift is none, and a light press is.

A contact that the drift explains is published in its sixth frame. Any other is published in its first frame.
"""

from __future__ import annotations

import ctypes

import pytest
from contact_steps_in_c import COMPILED, Estimate, TouchInC
from test_touch import COVARIANCE, at_chi2

from fmfts_lab.bench.warm_presses import LASTING_FRAMES, SPOTS, WarmPad, lasting_onset
from oracle.compiled import part_of

SEED = 501


COMPILED.fmfts_is_published.restype = ctypes.c_bool


def onsets(published: list[bool]) -> int:
    return sum(after and not before for before, after in zip([False, *published], published, strict=False))


def test_drift_that_looks_like_a_press_makes_no_contact() -> None:
    """Before, this pad published 78 contacts of 107 frames in 155 s."""
    seen = WarmPad(4, kelvin=10.0, times=3.0, seconds=145.0, stays_s=10.0).untouched
    assert onsets([one.begun for one in seen]) > 50
    assert not any(one.published for one in seen)


@pytest.mark.parametrize(
    ("spot", "force_n", "rate_n_per_s"), [("middle", 0.12, 0.05), ("rim", 0.3, 0.3), ("rim", 0.12, 3.0)]
)
def test_slow_press_on_warm_pad_is_published(spot: str, force_n: float, rate_n_per_s: float) -> None:
    """A mean of a quarter of a second, which followed slow presses, hid the first two."""
    pad = WarmPad(SEED, kelvin=10.0, times=3.0)
    seen = pad.pressed(SPOTS[spot], force_n, rate_n_per_s)
    onset = lasting_onset(seen)
    assert onset is not None
    late = [one.published for one in seen[onset:]].index(True)
    assert late == LASTING_FRAMES - 1, "the drift explains so light a press"
    assert all(one.published for one in seen[-100:])


@pytest.mark.parametrize("seed", [502, 503, 504])
def test_force_of_a_contact_that_waits_is_within_three_deviations(seed: int) -> None:
    """Zero is published then, and its deviation has to cover the press: a controller adds three (docs/messages.md)."""
    force_n = 0.2
    seen = WarmPad(seed, kelvin=25.0, times=1.0).pressed(SPOTS["middle"], force_n, 200.0)
    waiting = [one for one in seen if one.begun and not one.published]
    assert waiting
    assert all(one.force_n == 0.0 and force_n < 3.0 * one.force_sd_n for one in waiting)


def test_firm_press_on_warm_pad_is_published_at_once() -> None:
    """The drift explains none of its frames."""
    seen = WarmPad(SEED, kelvin=10.0, times=3.0).pressed(0.0, 1.0, 100.0)
    assert [one.published for one in seen] == [one.begun for one in seen]
    assert onsets([one.begun for one in seen]) == 1


@pytest.mark.parametrize("kelvin", [0.0, 4.0])
def test_contact_on_unwarmed_pad_is_published_in_its_first_frame(kelvin: float) -> None:
    pad = WarmPad(SEED, kelvin=kelvin, times=1.0)
    for spot in SPOTS.values():
        for rate_n_per_s in (0.3, 3.0):
            seen = pad.pressed(spot, 0.12, rate_n_per_s)
            assert lasting_onset(seen) is not None
            assert [one.published for one in seen] == [one.begun for one in seen]


def published(explained: list[bool], pressed: list[bool] | None = None) -> list[bool]:
    """Of frames whose contact the drift explains, or not. pressed: whether there is a contact."""
    detector, told = TouchInC(), []
    for is_explained, is_pressed in zip(explained, pressed or [True] * len(explained), strict=True):
        was_contact = detector.memory.number("in_contact") != 0.0
        detector.update(at_chi2(100.0), COVARIANCE)
        detector.presses(Estimate.of(0.5 if is_pressed else 0.0, 0.1, 0.1))
        COMPILED.fmfts_doubt_drift(part_of(detector.memory), ctypes.c_bool(was_contact), ctypes.c_bool(is_explained))
        told.append(bool(COMPILED.fmfts_is_published(part_of(detector.memory))))
    return told


def test_doubt_lasts_for_five_frames_or_until_no_drift_explains_the_contact() -> None:
    assert published([False] * 3) == [True] * 3
    assert published([True] * 8) == [False] * 5 + [True] * 3
    assert published([True, True, False, True, True]) == [False, False, True, True, True]


def test_doubt_begins_anew_with_each_contact() -> None:
    pressed = [True] * 5 + [False] + [True] * 6
    assert published([True] * 12, pressed) == [False] * 11 + [True]


def test_gap_ends_the_doubt() -> None:
    detector = TouchInC()
    detector.update(at_chi2(100.0), COVARIANCE)
    detector.presses(Estimate.of(0.5, 0.1, 0.1))
    COMPILED.fmfts_doubt_drift(part_of(detector.memory), ctypes.c_bool(False), ctypes.c_bool(True))
    assert detector.memory.number("doubtful_frames") == 1.0
    detector.forget()
    assert detector.memory.number("doubtful_frames") == 0.0
