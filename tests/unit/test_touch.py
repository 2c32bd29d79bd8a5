"""Contact or none: how often an unloaded pad is believed touched, and how a contact begins and ends."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from contact_steps_in_c import Estimate, TouchInC
from scipy.special import chdtrc as tail_of_chi2

from fmfts.contact._contact import RELEASE_FRAMES
from fmfts.contact.touch import TouchDetector

REST = np.zeros(5)
# Of several magnets and of one.
BOTH = pytest.mark.parametrize("kind", [TouchDetector, TouchInC])
Kind = type[TouchDetector] | type[TouchInC]
COVARIANCE = np.diag([8.6e-6, 8.6e-6, 6.1e-6, 2e-3, 2e-3]) ** 2


def at_chi2(value: float) -> np.ndarray:
    """A displacement whose χ² is `value`, along no axis of the covariance."""
    direction = np.array([1.0, -2.0, 0.5, 1.5, -1.0])
    return np.sqrt(value * np.diagonal(COVARIANCE)) * direction / np.linalg.norm(direction)


def test_onset_is_one_false_contact_per_pad_hour() -> None:
    detector = TouchDetector(rate_hz=220.0)
    assert tail_of_chi2(5, detector.onset_chi2) * 220 * 3600 == pytest.approx(1.0, rel=1e-6)
    assert tail_of_chi2(5, TouchDetector(100.0, 0.1).onset_chi2) * 100 * 3600 == pytest.approx(0.1, rel=1e-6)
    of_four = TouchDetector(220.0, magnets=4)
    assert tail_of_chi2(20, of_four.onset_chi2) * 220 * 3600 == pytest.approx(1.0, rel=1e-6)
    assert tail_of_chi2(20, of_four.release_chi2) == pytest.approx(0.01, rel=1e-6)


@BOTH
def test_false_contacts_of_noise_come_at_the_stated_rate(kind: Kind) -> None:
    """720 an hour at 100 Hz, one frame in 500: 200 000 frames of noise give 400 ± 20 exceedances, fewer onsets."""
    noise = np.random.default_rng(1).multivariate_normal(REST, COVARIANCE, 200_000, method="cholesky")
    detector = kind(rate_hz=100.0, false_contacts_per_hour=720.0)
    states = [detector.update(displacement, COVARIANCE) for displacement in noise]
    onsets = sum(after is True and before is False for before, after in zip([False, *states], states, strict=False))
    assert 320 < onsets < 440


@BOTH
def test_contact_begins_with_one_frame_and_ends_after_several_quiet_ones(kind: Kind) -> None:
    detector = kind(rate_hz=220.0)
    assert detector.update(at_chi2(detector.onset_chi2 * 0.99), COVARIANCE) is False
    assert detector.update(at_chi2(detector.onset_chi2 * 1.01), COVARIANCE) is True
    assert detector.update(at_chi2(detector.release_chi2 * 1.1), COVARIANCE) is True
    quiet = [detector.update(REST, COVARIANCE) for _ in range(RELEASE_FRAMES)]
    assert quiet == [True] * (RELEASE_FRAMES - 1) + [False]


def estimate(force_n: float, pose_sd_n: float) -> Estimate:
    """The rest of the deviation is the model's own error: 0.3 of the force."""
    return Estimate.of(force_n, float(np.hypot(pose_sd_n, 0.3 * force_n)), pose_sd_n)


def touched(hidden_n: float = 0.0) -> TouchInC:
    detector = TouchInC(hidden_n=hidden_n)
    detector.update(at_chi2(100.0), COVARIANCE)
    return detector


def test_force_within_two_deviations_of_zero_is_no_contact() -> None:
    """A tool that passed a hand which was never turned read as 2.84 ± 2.60 N, with health ok."""
    assert not touched().presses(estimate(2.84, 2.60))
    assert not touched().presses(estimate(0.19, 0.1))
    assert touched().presses(estimate(0.21, 0.1))


def test_contact_stays_until_its_force_is_within_one_deviation() -> None:
    detector = touched()
    forces = (0.19, 0.21, 0.19, 0.11, 0.09, 0.19)
    assert [detector.presses(estimate(force, 0.1)) for force in forces] == [False, True, True, True, False, False]


def test_hidden_field_that_resembles_a_force_is_no_contact() -> None:
    detector = touched(hidden_n=0.1)
    forces = (0.19, 0.21, 0.11, 0.09)
    assert [detector.presses(estimate(force, 1e-3)) for force in forces] == [False, True, True, False]
    # Where the place is uncertain, the model's own error is as large as the apparent force of a passing tool.
    at_the_rim = Estimate.of(0.48, 0.3, 0.1)
    assert not detector.presses(at_the_rim)
    assert touched().presses(at_the_rim)


def test_certain_force_of_a_magnet_at_rest_is_no_contact() -> None:
    assert not TouchInC().presses(estimate(5.0, 0.1))


def test_contact_with_untrusted_numbers_still_counts() -> None:
    assert touched().presses(Estimate.of(0.0, 0.1, 0.1, refused=True))


def test_contact_must_be_certain_anew_after_a_gap_and_a_baseline() -> None:
    def gap(detector: TouchInC) -> None:
        for _ in range(RELEASE_FRAMES):
            detector.unseen()

    afterwards: list[Callable[[TouchInC], None]] = [gap, TouchInC.forget]
    for forgotten in afterwards:
        detector = touched()
        assert detector.presses(estimate(0.21, 0.1))
        forgotten(detector)
        assert not detector.touched
        detector.update(at_chi2(100.0), COVARIANCE)
        assert not detector.presses(estimate(0.15, 0.1))


def test_moved_magnet_without_certain_force_has_a_wide_deviation() -> None:
    detector, contact = touched(), estimate(2.84, 2.60)
    assert not detector.presses(contact)
    assert detector.force_sd_n(contact, 0.02) > np.hypot(2.84, 2.60)
    detector.forget()
    assert detector.force_sd_n(contact, 0.02) == pytest.approx(np.hypot(2.60, 0.02 / np.sqrt(3.0)))


def test_press_is_certain_before_its_force_is() -> None:
    """A firm press on the rim or a light one nearer the middle: the force is 0.9 ± 0.6 N, but not 0."""
    detector = TouchInC()
    assert detector.update(np.full(5, 1e-3), np.eye(5) * 1e-9)
    estimate = Estimate.of(0.9, 0.6, 0.6)
    said = []
    for lowered in (0.0, 0.9, 1.1):
        estimate.lowered_chi2 = lowered * detector.onset_chi2
        said.append(detector.presses(estimate))
    assert said == [False, False, True]
    others = TouchInC()
    others.update(np.full(5, 1e-3), np.eye(5) * 1e-9)
    estimate.explained = 0.9  # as beside a magnet
    assert not others.presses(estimate)
    estimate.explained = 1.0
    assert detector.force_sd_n(estimate, 0.0) == pytest.approx(np.hypot(0.9, 0.6))  # the force may still be 0
    estimate.lowered_chi2 = 1.1 * detector.release_chi2
    assert detector.presses(estimate)
    estimate.lowered_chi2 = 0.9 * detector.release_chi2
    assert not detector.presses(estimate)


def test_where_steel_passes_only_a_certain_force_is_a_contact() -> None:
    detector = TouchInC(hidden_n=0.1)
    assert detector.update(np.full(5, 1e-3), np.eye(5) * 1e-9)
    estimate = Estimate.of(0.9, 0.6, 0.6)
    estimate.lowered_chi2 = 10.0 * detector.onset_chi2
    assert not detector.presses(estimate)


def test_force_near_its_noise_may_be_up_to_detection_limit_off() -> None:
    detector = touched()
    for force_n, deviation_n, doubt in ((0.3, 0.1, 4.0 / 9.0), (0.21, 0.2, 1.0), (2.0, 0.1, 0.01)):
        contact = Estimate.of(force_n, deviation_n, 0.01)
        assert detector.presses(contact)
        expected = np.hypot(deviation_n, doubt * 0.5 / np.sqrt(3.0))
        assert detector.force_sd_n(contact, 0.5) == pytest.approx(expected)


@BOTH
def test_contact_near_the_threshold_does_not_flicker(kind: Kind) -> None:
    """A steady push between release and onset, seen through noise, keeps the state that it has."""
    detector = kind(rate_hz=220.0)
    push = at_chi2(30.0)
    noise = np.random.default_rng(2).multivariate_normal(push, COVARIANCE, 2000, method="cholesky")
    detector.update(at_chi2(100.0), COVARIANCE)
    assert all(detector.update(displacement, COVARIANCE) for displacement in noise)


@BOTH
def test_without_pose_there_is_no_answer_and_contact_outlasts_gap(kind: Kind) -> None:
    detector = kind(rate_hz=220.0)
    detector.update(at_chi2(100.0), COVARIANCE)
    assert detector.update(REST * np.nan, COVARIANCE) is None
    assert detector.update(REST, COVARIANCE * 0.0) is None
    assert detector.update(REST, COVARIANCE * np.nan) is None
    assert detector.update(REST, COVARIANCE) is True


def after_a_gap(kind: Kind, frames: int) -> TouchDetector | TouchInC:
    """Touched before it."""
    detector = kind(rate_hz=220.0)
    detector.update(at_chi2(100.0), COVARIANCE)
    for _ in range(frames):
        detector.unseen()
    return detector


@BOTH
def test_finger_lifted_in_a_gap_is_released_after_it(kind: Kind) -> None:
    for chance in (0.0, 1.1):
        detector = after_a_gap(kind, 2 * RELEASE_FRAMES)
        assert detector.update(at_chi2(detector.release_chi2 * chance), COVARIANCE) is False


@BOTH
def test_finger_held_through_a_gap_is_in_the_first_frame_after(kind: Kind) -> None:
    detector = after_a_gap(kind, 2 * RELEASE_FRAMES)
    assert detector.update(at_chi2(detector.onset_chi2 * 1.1), COVARIANCE) is True
    assert [detector.update(REST, COVARIANCE) for _ in range(RELEASE_FRAMES)] == [True] * (RELEASE_FRAMES - 1) + [False]


@BOTH
def test_finger_missing_for_a_few_frames_still_touches(kind: Kind) -> None:
    detector = after_a_gap(kind, RELEASE_FRAMES - 1)
    assert detector.update(at_chi2(detector.release_chi2 * 1.1), COVARIANCE) is True
