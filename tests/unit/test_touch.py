"""Contact or none: how often an unloaded pad is believed touched, and how a contact begins and ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from fmfts.contact import ContactEstimate
from fmfts.contact.touch import RELEASE_FRAMES, TouchDetector
from fmfts.pipeline.deviations import published_force_sd_n

REST = np.zeros(5)
COVARIANCE = np.diag([8.6e-6, 8.6e-6, 6.1e-6, 2e-3, 2e-3]) ** 2


def at_chi2(value: float) -> np.ndarray:
    """A displacement whose χ² is `value`, along no axis of the covariance."""
    direction = np.array([1.0, -2.0, 0.5, 1.5, -1.0])
    return np.sqrt(value * np.diagonal(COVARIANCE)) * direction / np.linalg.norm(direction)


def test_onset_is_one_false_contact_per_pad_hour() -> None:
    detector = TouchDetector(rate_hz=220.0)
    assert chi2.sf(detector.onset_chi2, 5) * 220 * 3600 == pytest.approx(1.0, rel=1e-6)
    assert chi2.sf(TouchDetector(100.0, 0.1).onset_chi2, 5) * 100 * 3600 == pytest.approx(0.1, rel=1e-6)
    of_four = TouchDetector(220.0, magnets=4)
    assert chi2.sf(of_four.onset_chi2, 20) * 220 * 3600 == pytest.approx(1.0, rel=1e-6)
    assert chi2.sf(of_four.release_chi2, 20) == pytest.approx(0.01, rel=1e-6)


def test_false_contacts_of_noise_come_at_the_stated_rate() -> None:
    """720 an hour at 100 Hz, one frame in 500: 200 000 frames of noise give 400 ± 20 exceedances, fewer onsets."""
    noise = np.random.default_rng(1).multivariate_normal(REST, COVARIANCE, 200_000, method="cholesky")
    detector = TouchDetector(rate_hz=100.0, false_contacts_per_hour=720.0)
    states = [detector.update(displacement, COVARIANCE) for displacement in noise]
    onsets = sum(after is True and before is False for before, after in zip([False, *states], states, strict=False))
    assert 320 < onsets < 440


def test_contact_begins_with_one_frame_and_ends_after_several_quiet_ones() -> None:
    detector = TouchDetector(rate_hz=220.0)
    assert detector.update(at_chi2(detector.onset_chi2 * 0.99), COVARIANCE) is False
    assert detector.update(at_chi2(detector.onset_chi2 * 1.01), COVARIANCE) is True
    assert detector.update(at_chi2(detector.release_chi2 * 1.1), COVARIANCE) is True
    quiet = [detector.update(REST, COVARIANCE) for _ in range(RELEASE_FRAMES)]
    assert quiet == [True] * (RELEASE_FRAMES - 1) + [False]


def estimate(force_n: float, pose_sd_n: float) -> ContactEstimate:
    """The rest of the deviation is the model's own error: 0.3 of the force."""
    spread = np.diag([1e-6, 1e-6, pose_sd_n**2 + (0.3 * force_n) ** 2])
    return ContactEstimate(0.0, 0.0, force_n, spread, False, None, 0.0, pose_sd_n, pose_sd_n)


def touched() -> TouchDetector:
    detector = TouchDetector(rate_hz=220.0)
    detector.update(at_chi2(100.0), COVARIANCE)
    return detector


def test_force_within_two_deviations_of_none_is_no_contact() -> None:
    """A tool that passed a hand which was never turned read as 2.84 ± 2.60 N, with health ok."""
    assert not touched().presses(estimate(2.84, 2.60))
    assert not touched().presses(estimate(0.19, 0.1))
    assert touched().presses(estimate(0.21, 0.1))


def test_contact_stays_until_its_force_is_within_one_deviation() -> None:
    detector = touched()
    forces = (0.19, 0.21, 0.19, 0.11, 0.09, 0.19)
    assert [detector.presses(estimate(force, 0.1)) for force in forces] == [False, True, True, True, False, False]


def test_force_that_a_hidden_field_looks_like_is_no_contact() -> None:
    detector = touched()
    detector.hidden_force_sd_n = 0.1
    forces = (0.19, 0.21, 0.11, 0.09)
    assert [detector.presses(estimate(force, 1e-3)) for force in forces] == [False, True, True, False]
    # Where the place is doubtful, the model's own error is as large as the force that a passing tool looks like.
    at_the_rim = replace(estimate(0.48, 0.1), covariance=np.diag([1e-6, 1e-6, 0.3**2]))
    assert not detector.presses(at_the_rim)
    assert touched().presses(at_the_rim)


def test_certain_force_of_a_magnet_at_rest_is_no_contact() -> None:
    assert not TouchDetector(rate_hz=220.0).presses(estimate(5.0, 0.1))


def test_contact_of_which_no_number_can_be_trusted_is_one() -> None:
    assert touched().presses(replace(estimate(0.0, 0.1), refused=True))


def test_contact_must_be_certain_anew_after_a_gap_and_a_baseline() -> None:
    def gap(detector: TouchDetector) -> None:
        for _ in range(RELEASE_FRAMES):
            detector.unseen()

    afterwards: list[Callable[[TouchDetector], None]] = [gap, TouchDetector.forget]
    for forgotten in afterwards:
        detector = touched()
        assert detector.presses(estimate(0.21, 0.1))
        forgotten(detector)
        assert not detector.memory.touched
        detector.update(at_chi2(100.0), COVARIANCE)
        assert not detector.presses(estimate(0.15, 0.1))


def test_moved_magnet_without_a_certain_force_may_press_as_hard_as_it_seems() -> None:
    detector, contact = touched(), estimate(2.84, 2.60)
    assert not detector.presses(contact)
    assert published_force_sd_n(contact, detector.memory, 0.02) > np.hypot(2.84, 2.60)
    detector.forget()
    assert published_force_sd_n(contact, detector.memory, 0.02) == pytest.approx(np.hypot(2.60, 0.02 / np.sqrt(3.0)))


def test_contact_near_the_threshold_does_not_flicker() -> None:
    """A steady push between release and onset, seen through noise, keeps the state that it has."""
    detector = TouchDetector(rate_hz=220.0)
    push = at_chi2(30.0)
    noise = np.random.default_rng(2).multivariate_normal(push, COVARIANCE, 2000, method="cholesky")
    detector.update(at_chi2(100.0), COVARIANCE)
    assert all(detector.update(displacement, COVARIANCE) for displacement in noise)


def test_without_a_pose_there_is_no_answer_and_a_contact_outlasts_the_gap() -> None:
    detector = TouchDetector(rate_hz=220.0)
    detector.update(at_chi2(100.0), COVARIANCE)
    assert detector.update(None, None) is None
    assert detector.update(REST * np.nan, COVARIANCE) is None
    assert detector.update(REST, COVARIANCE * 0.0) is None
    assert detector.update(REST, COVARIANCE * np.nan) is None
    assert detector.update(REST, COVARIANCE) is True


def after_a_gap(frames: int) -> TouchDetector:
    """Touched before it."""
    detector = TouchDetector(rate_hz=220.0)
    detector.update(at_chi2(100.0), COVARIANCE)
    for _ in range(frames):
        detector.unseen()
    return detector


def test_finger_that_went_in_a_gap_is_gone_in_the_first_frame_after_it_that_is_no_onset() -> None:
    for chance in (0.0, 1.1):
        detector = after_a_gap(2 * RELEASE_FRAMES)
        assert detector.update(at_chi2(detector.release_chi2 * chance), COVARIANCE) is False


def test_finger_that_stays_through_a_gap_is_there_in_the_first_frame_after_it() -> None:
    detector = after_a_gap(2 * RELEASE_FRAMES)
    assert detector.update(at_chi2(detector.onset_chi2 * 1.1), COVARIANCE) is True
    assert [detector.update(REST, COVARIANCE) for _ in range(RELEASE_FRAMES)] == [True] * (RELEASE_FRAMES - 1) + [False]


def test_finger_that_is_not_seen_for_a_few_frames_still_touches() -> None:
    detector = after_a_gap(RELEASE_FRAMES - 1)
    assert detector.update(at_chi2(detector.release_chi2 * 1.1), COVARIANCE) is True
