from __future__ import annotations

import numpy as np
import pytest

from fmfts.pose import Alignment

PERIOD_US = 4545
FRESH = np.ones(4, dtype=bool)


def _rows(*values: float) -> np.ndarray:
    return np.repeat(np.array(values)[:, None], 3, axis=1)


def test_simultaneous_samples_pass_unchanged() -> None:
    alignment = Alignment(4, PERIOD_US)
    for step in range(4):
        field = _rows(1.0, 2.0, 3.0, 4.0) * (step + 1)
        aligned = alignment.push(field, np.full(4, 1000 + step * PERIOD_US), FRESH)
        assert aligned.field_t == pytest.approx(field)
        assert aligned.bend_t == pytest.approx(np.zeros((4, 3)))
        assert aligned.noise_share == pytest.approx(np.ones((4, 1)))


def test_steady_motion_is_brought_to_one_instant_exactly() -> None:
    alignment = Alignment(4, PERIOD_US)
    offsets = np.array([0, 1200, 2500, 4000])
    for step in range(5):
        time_us = 1000 + step * PERIOD_US + offsets
        aligned = alignment.push(_rows(*(time_us * 1e-6)), time_us, FRESH)
    assert aligned.time_us == 1000 + 4 * PERIOD_US
    assert aligned.field_t == pytest.approx(np.full((4, 3), aligned.time_us * 1e-6), rel=1e-12)


def test_bend_bounds_the_error_of_a_tap() -> None:
    """A 1 N tap of 50 ms at the centre moves a field by about 0.3 G; its curvature must not look like a fault."""
    alignment = Alignment(4, PERIOD_US)
    offsets = np.array([0, 1200, 2500, 4000])

    def tap(time_us: np.ndarray | float) -> np.ndarray:
        phase = np.clip(np.asarray(time_us) / 50_000.0, 0.0, 1.0)
        return 3e-5 * np.sin(np.pi * phase) ** 2

    worst_excess = 0.0
    for step in range(1, 14):
        time_us = step * PERIOD_US + offsets
        aligned = alignment.push(_rows(*tap(time_us)), time_us, FRESH)
        if step > 3:
            error = np.abs(aligned.field_t - tap(aligned.time_us))
            # Within four of (curvature, 2 mG noise): a χ² gate accepts this.
            worst_excess = max(worst_excess, float((error / np.hypot(aligned.bend_t, 2e-7)).max()))
    assert worst_excess < 4.0


def test_bend_bounds_the_error_of_a_jump() -> None:
    """A magnet that is put back is there from one sample to the next; chips interpolate across the moment."""
    alignment = Alignment(4, PERIOD_US)
    offsets = np.array([0, 1200, 2500, 4000])
    jump_us, jump_t = 6 * PERIOD_US + 100, 1e-4
    jumped = False
    for step in range(1, 12):
        time_us = step * PERIOD_US + offsets
        aligned = alignment.push(_rows(*(jump_t * (time_us > jump_us))), time_us, FRESH)
        error = np.abs(aligned.field_t - jump_t * (aligned.time_us > jump_us))
        jumped |= bool(error.max() > 0.5 * jump_t)
        if step > 3:
            assert (error <= aligned.bend_t + 1e-12).all()
    assert jumped


def test_stopped_chip_does_not_hold_the_others_back() -> None:
    alignment = Alignment(4, PERIOD_US)
    fresh = np.array([True, True, True, False])
    stopped_at = 1000
    for step in range(6):
        time_us = np.array([1000 + step * PERIOD_US] * 3 + [stopped_at])
        aligned = alignment.push(_rows(1.0, 1.0, 1.0, 9.0), time_us, FRESH if step == 0 else fresh)
    assert aligned.time_us == 1000 + 5 * PERIOD_US
    assert np.isnan(aligned.field_t[3]).all()
    assert np.isfinite(aligned.field_t[:3]).all()


def test_sensor_without_a_measurement_stays_without_one() -> None:
    alignment = Alignment(4, PERIOD_US)
    for step in range(3):
        field = _rows(1.0, np.nan, 1.0, 1.0)
        field[2, 0] = np.nan
        aligned = alignment.push(field, np.full(4, 1000 + step * PERIOD_US), FRESH)
    assert np.isnan(aligned.field_t[1]).all()
    assert np.isnan(aligned.field_t[2, 0])
    assert np.isfinite(aligned.field_t[[0, 3]]).all()


def test_saturated_axis_does_not_repeat_its_past() -> None:
    alignment = Alignment(4, PERIOD_US)
    offsets = np.array([0, 1200, 2500, 4000])
    for step in range(4):
        field = _rows(1.0, 1.0, 1.0, 1.0)
        if step == 3:
            field[3, 1] = np.nan
        aligned = alignment.push(field, 1000 + step * PERIOD_US + offsets, FRESH)
    assert np.isnan(aligned.field_t[3, 1])


def test_frame_without_samples_aligns_to_no_sample() -> None:
    alignment = Alignment(4, PERIOD_US)
    aligned = alignment.push(np.full((4, 3), np.nan), np.zeros(4, dtype=np.int64), np.zeros(4, dtype=bool))
    assert np.isnan(aligned.field_t).all()


def test_frames_without_a_valid_sensor_are_no_reset_of_the_board() -> None:
    """Their ages are 65535 µs, "that or more": as a time it would lie before the samples that came last."""
    alignment = Alignment(4, PERIOD_US)
    last_us = 10_000_000
    for step in (2, 1, 0):
        alignment.push(_rows(1.0, 2.0, 3.0, 4.0), np.full(4, last_us - step * PERIOD_US), FRESH)
    before = alignment.memory.time_us.copy()
    for step in range(1, 100):
        unknown_us = np.full(4, last_us + step * PERIOD_US - 65535)
        aligned = alignment.push(np.full((4, 3), np.nan), unknown_us, ~FRESH, ~FRESH)
        assert aligned.time_us == last_us
        assert np.isnan(aligned.field_t).all()
    assert (alignment.memory.time_us == before).all()


def test_reset_of_the_board_is_seen_from_its_valid_sensors() -> None:
    alignment = Alignment(4, PERIOD_US)
    valid = np.array([True, True, False, True])
    alignment.push(_rows(1.0, 2.0, 3.0, 4.0), np.full(4, 10_000_000), FRESH)
    aligned = alignment.push(_rows(1.0, 2.0, np.nan, 4.0), np.array([5000, 5000, 5000 - 65535, 5000]), valid, valid)
    assert aligned.time_us == 5000


def test_samples_before_a_long_gap_add_no_uncertainty_after_it() -> None:
    """The pad moved meanwhile: a line across the gap would be uncertain by the whole movement."""
    alignment = Alignment(4, PERIOD_US)
    offsets = np.array([0, 1200, 2500, 4000])
    for step in range(4):
        alignment.push(_rows(1e-4, 1e-4, 1e-4, 1e-4), 1000 + step * PERIOD_US + offsets, FRESH)
    moved = _rows(3e-4, 3e-4, -1e-4, 5e-4)
    aligned = alignment.push(moved, 500_000 + offsets, FRESH)
    assert aligned.field_t == pytest.approx(moved)
    assert (aligned.bend_t == 0.0).all()


def test_gap_at_the_end_of_a_tap_widens_deviations() -> None:
    """A chip faster than the frames loses a conversion now and then, just as a 0.3 G tap of 50 ms ends."""

    def tap(time_us: np.ndarray | float) -> np.ndarray:
        phase = np.clip(np.asarray(time_us) / 50_000.0, 0.0, 1.0)
        return 3e-5 * np.sin(np.pi * phase) ** 2

    for phase_us in range(0, PERIOD_US, 250):
        alignment = Alignment(4, PERIOD_US)
        steps = np.arange(5, 12)
        for step in steps:
            time_us = step * PERIOD_US + phase_us + np.array([0, 1200, 2500, 4000])
            if step == 9:
                continue  # a conversion of every chip between the frames
            aligned = alignment.push(_rows(*tap(time_us)), time_us, FRESH)
            if step == 10:
                error = np.abs(aligned.field_t - tap(aligned.time_us))
                assert (error / np.hypot(aligned.bend_t, 2e-7)).max() < 2.0


def test_sample_of_a_lost_frame_is_taken_from_the_next() -> None:
    """The last chip is slower than the frames: frame 5 repeats its sample of frame 4, which was left out."""
    alignment = Alignment(4, PERIOD_US)
    offsets = np.array([0, 1200, 2500, 4000])
    for step in range(3):
        time_us = 1000 + step * PERIOD_US + offsets
        alignment.push(_rows(*(1e-9 * time_us)), time_us, FRESH)
    time_us = 1000 + np.array([5, 5, 5, 4]) * PERIOD_US + offsets
    aligned = alignment.push(_rows(*(1e-9 * time_us)), time_us, np.array([True, True, True, False]))
    assert aligned.time_us == time_us[3]
    assert aligned.field_t == pytest.approx(np.repeat(1e-9 * time_us[3], 12).reshape(4, 3))
    again = alignment.push(_rows(*(1e-9 * time_us)), time_us, ~FRESH)
    assert (again.repeats == 0).all()  # it was excluded once
    assert again.time_us == aligned.time_us


def test_sample_of_unknown_time_is_not_taken_as_new() -> None:
    alignment = Alignment(4, PERIOD_US)
    for step in range(3):
        alignment.push(_rows(1.0, 1.0, 1.0, 1.0), np.full(4, 100_000 + step * PERIOD_US), FRESH)
    before = alignment.memory.time_us.copy()
    alignment.push(_rows(1.0, 1.0, 1.0, 1.0), np.full(4, 200_000), ~FRESH, ~FRESH)
    assert (alignment.memory.time_us == before).all()


def test_frame_of_another_number_of_sensors_changes_nothing() -> None:
    alignment = Alignment(4, PERIOD_US)
    alignment.push(np.ones((4, 3)), np.full(4, 1000), FRESH)
    before = alignment.memory.time_us.copy()
    with pytest.raises(ValueError, match="array 0 has 288 bytes, 360 expected for 5 sensors"):
        alignment.push(np.ones((5, 3)), np.full(5, 6000), np.ones(5, dtype=bool))
    assert (alignment.memory.time_us == before).all()
