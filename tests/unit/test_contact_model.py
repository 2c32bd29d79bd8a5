"""The model that ships: its accuracy, and its statements about its own errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from numpy.typing import NDArray

from fmfts.contact import ContactEstimate, ContactModel
from fmfts.contact.contract import parse_response
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.pad import Pad
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.bounds import bound_of
from fmfts_calibrate.dataset import read_calibration_set, standard_pad
from fmfts_calibrate.tracked import FrameSolver, Tracked
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of
from fmfts_simulation.solved_table import standard_mechanics

CALIBRATION = Path(__file__).parents[1] / "data" / "calibration_1.23T.csv"


Array = NDArray[np.float64]


CERTAIN = np.eye(6) * 1e-16  # deviations of 10 nm and 1e-8


@pytest.fixture
def pad() -> Pad:
    """The pad that the model was made for, with a cylinder as magnet."""
    return standard_pad()


@pytest.fixture
def model(pad: Pad) -> ContactModel:
    return ContactModel.load("default", pad)


@dataclass(frozen=True)
class Frames:
    """Single frames of presses (K, 3) in mm and N, solved with eight unknowns."""

    press: Array
    tracked: Tracked

    @classmethod
    def of(cls, pad: Pad, press: Array, noise_t: float = 0.0, remanence_t: float = 1.23, seed: int = 0) -> Frames:
        magnet = pad.magnet.with_remanence(remanence_t)
        field = pressed_fields(pad, press, magnet)
        noise = noise_t * np.random.default_rng(seed).standard_normal(field.shape)
        solver = FrameSolver(pad, rest_field_of(pad, magnet), "drifting", NOISE_T)
        return cls(press, solver.solved(field + noise))

    @classmethod
    def drawn(cls, pad: Pad, count: int, lowest_n: float, highest_n: float, reach_m: float, seed: int) -> Frames:
        """Noisy frames of presses within a radius."""
        random = np.random.default_rng(seed)
        radius, angle = reach_m * 1e3 * np.sqrt(random.uniform(0, 1, count)), random.uniform(0, 2 * np.pi, count)
        force = random.uniform(lowest_n, highest_n, count)
        press = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), force])
        return cls.of(pad, press, NOISE_T, seed=seed)

    def estimates(self, model: ContactModel) -> list[ContactEstimate]:
        """The pipeline's result for each, with the solver's covariance."""
        unit, out = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0]), []
        for pose, covariance in zip(self.tracked.pose, self.tracked.covariance, strict=True):
            full = np.zeros((6, 6))
            full[:5, :5] = covariance * unit * unit[:, None]
            out.append(model.estimate(pose[:3] * 1e-3, pose[3:], full))
        return out

    def found(self, model: ContactModel) -> Array:
        """(K, 3) in mm and N."""
        return np.array([[one.x_m * 1e3, one.y_m * 1e3, one.force_n] for one in self.estimates(model)])


# --- its answers ---


def test_jacobian_is_the_derivative_of_the_contact(pad: Pad) -> None:
    """Differences over 1/100 of a unit, of answers that float32 rounds to 1e-6 mm: good to 1 % of the largest slope."""
    session = onnxruntime.InferenceSession(DEFAULT_PATH, providers=["CPUExecutionProvider"])
    pose = Frames.drawn(pad, 40, 0.0, 1.9, 14e-3, seed=21).tracked.pose
    _, jacobian = session.run(None, {"pose": pose.astype(np.float32)})
    scale = np.array([0.2, 0.2, 0.6, 0.05, 0.05])
    for column, step in enumerate(np.diag(5e-3 * scale)):
        moved = [
            session.run(None, {"pose": (pose + sign * np.append(step, 0.0)).astype(np.float32)})[0] for sign in (1, -1)
        ]
        slope = (moved[0] - moved[1]) / 2 / 5e-3
        expected = jacobian[:, :, column] * scale[column]
        firm = np.linalg.norm((pose - [0, 0, 12, 0, 0, 1])[:, :5] / scale, axis=1) > 0.2
        assert firm.sum() > 25
        np.testing.assert_allclose(slope[firm], expected[firm], atol=0.01 * np.abs(expected[firm]).max())
    assert not jacobian[:, :, 5].any()  # the axis's last component follows from the others


def test_calibration_set_is_met_on_the_grid(pad: Pad, model: ContactModel) -> None:
    """Noise-free, its inner 8 mm at the paper's two firm forces: 0.1 mm and 20 mN, a fraction of a frame's noise."""
    table = read_calibration_set(CALIBRATION)
    inner = (np.hypot(table.x_m, table.y_m) <= 8e-3) & (table.force_n > 1.0)
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    frames = Frames(table.press[inner], solver.solved(table.field_t[inner]))
    assert (np.abs(frames.found(model) - frames.press) < [0.1, 0.1, 0.02]).all()


def test_model_meets_new_presses_without_noise(pad: Pad, model: ContactModel) -> None:
    """Within 8 mm, from the paper's lightest force to its firmest: at most 0.05 mm and 5 mN on average."""
    press = Frames.drawn(pad, 300, 0.28, 1.98, 8e-3, seed=71).press
    error = np.abs(Frames.of(pad, press).found(model) - press).mean(axis=0)
    assert (error < [0.05, 0.05, 0.005]).all()


def test_any_magnet_strength_gives_the_same_contact(pad: Pad, model: ContactModel) -> None:
    press = np.array([[4.0, -3.0, 1.0], [-9.0, 2.0, 0.4], [11.0, 11.0, 1.7]])
    usual = Frames.of(pad, press).found(model)
    for remanence_t in (0.6, 1.18, 1.28, 1.5):
        other = Frames.of(pad, press, remanence_t=remanence_t).found(model)
        np.testing.assert_allclose(other, usual, atol=0.01)  # mm and N: a hundredth of a corner's noise


@pytest.mark.parametrize(("lowest_n", "highest_n", "within"), [(0.05, 0.2, 1.45), (0.2, 0.8, 1.15), (0.8, 1.9, 1.15)])
def test_single_frames_come_near_the_cramer_rao_bound(
    pad: Pad, model: ContactModel, lowest_n: float, highest_n: float, within: float
) -> None:
    """At 2 mG within 8 mm. 500 frames give an rms to 3 %; the rest is the network's own error, and for light touches a
    place that is not linear in the noise."""
    frames = Frames.drawn(pad, 500, lowest_n, highest_n, 8e-3, seed=31)
    session = onnxruntime.InferenceSession(DEFAULT_PATH, providers=["CPUExecutionProvider"])
    response = parse_response(session.get_modelmeta().custom_metadata_map)
    assert response is not None
    _, slope = response.change_and_slope(frames.press)
    bound = bound_of(slope, frames.tracked.covariance)
    share = np.sqrt(np.mean(((frames.found(model) - frames.press) / bound)[:, :2] ** 2))
    assert 0.8 < share < within


@pytest.mark.parametrize(("lowest_n", "highest_n"), [(0.1, 0.3), (0.3, 1.0), (1.0, 1.9)])
def test_deviations_are_honest(pad: Pad, model: ContactModel, lowest_n: float, highest_n: float) -> None:
    """Within 8 mm at 2 mG, 95.4 % of errors should be below two deviations; 600 draws give that to 0.9 %."""
    frames = Frames.drawn(pad, 600, lowest_n, highest_n, 8e-3, seed=41)
    estimates = frames.estimates(model)
    error = np.abs(frames.found(model) - frames.press)
    deviation = np.array([[one.x_sd_m * 1e3, one.y_sd_m * 1e3, one.force_sd_n] for one in estimates])
    within = np.mean(error < 2.0 * deviation, axis=0)
    assert (within > 0.925).all()
    assert (within < 0.995).all()
    assert not any(one.over_range for one in estimates)


# --- the envelope ---


def test_rest_and_a_lifted_magnet_are_not_over_range(pad: Pad, model: ContactModel) -> None:
    rest = model.estimate(pad.rest_position_m, pad.rest_axis, CERTAIN)
    assert not rest.over_range
    assert rest.force_min_n is None
    assert abs(rest.force_n) < 0.02
    lifted = model.estimate(pad.rest_position_m + np.array([0.0, 0.0, 0.5e-3]), pad.rest_axis, CERTAIN)
    assert not lifted.over_range
    assert np.isfinite([lifted.x_m, lifted.y_m]).all()
    assert abs(lifted.force_n) < 0.02


@pytest.mark.parametrize("reach_m", [8e-3, 14e-3])
def test_lower_bound_of_a_squeeze_is_below_its_force(pad: Pad, model: ContactModel, reach_m: float) -> None:
    """Up to twice the largest calibrated force; at three deviations one in 700 may fail, of 400 none does."""
    frames = Frames.drawn(pad, 400, 2.05, 4.0, reach_m, seed=51)
    for estimate, force_n in zip(frames.estimates(model), frames.press[:, 2], strict=True):
        assert (estimate.force_min_n is not None) == estimate.over_range
        if estimate.force_min_n is not None:
            assert 1.0 < estimate.force_min_n <= force_n


def test_hard_squeeze_within_8_mm_is_over_range_with_a_bound(pad: Pad, model: ContactModel) -> None:
    frames = Frames.drawn(pad, 300, 2.3, 4.0, 8e-3, seed=52)
    found = frames.estimates(model)
    assert all(estimate.over_range for estimate in found)
    assert min(estimate.force_min_n or 0.0 for estimate in found) > 1.85
    # The place is still right: the displacement keeps its direction.
    error_mm = np.linalg.norm(frames.found(model)[:, :2] - frames.press[:, :2], axis=1)
    assert np.median(error_mm) < 0.5


def test_far_pose_is_judged_by_the_nearest_known_pose(pad: Pad, model: ContactModel) -> None:
    """Three and ten times a firm press's displacement: the same place, and nearly the calibrated force."""
    displacement_m, axis = standard_mechanics().displacement(np.array([4e-3]), np.array([2e-3]), np.array([1.9]))
    for times in (3.0, 10.0):
        tilt = axis[0, :2] * times
        turned = np.append(tilt, np.sqrt(1.0 - tilt @ tilt))
        estimate = model.estimate(pad.rest_position_m + times * displacement_m[0], turned, CERTAIN)
        assert estimate.over_range
        assert estimate.force_min_n is not None
        assert estimate.force_min_n > 1.8
        assert np.hypot(estimate.x_m - 4e-3, estimate.y_m - 2e-3) < 0.3e-3


def test_presses_up_to_the_calibrated_force_are_in_range(pad: Pad, model: ContactModel) -> None:
    frames = Frames.drawn(pad, 400, 0.0, 1.97, 14e-3, seed=53)
    assert not any(estimate.over_range for estimate in frames.estimates(model))


def test_answer_is_finite_for_any_finite_pose_and_refused_for_others(pad: Pad, model: ContactModel) -> None:
    random = np.random.default_rng(61)
    for size in (1e-6, 1e-3, 1.0, 1e6):
        for _ in range(50):
            axis = random.standard_normal(3)
            root = random.standard_normal((6, 6)) * size
            estimate = model.estimate(random.standard_normal(3) * size, axis / np.linalg.norm(axis), root @ root.T)
            assert np.isfinite([estimate.x_m, estimate.y_m, estimate.force_n]).all()
            assert np.isfinite(estimate.deviations).all()
            assert (estimate.deviations > 0.0).all()
            assert estimate.force_min_n is None or 0.0 <= estimate.force_min_n < 2.0
    with pytest.raises(ValueError, match="not finite"):
        model.estimate(np.array([0.0, np.nan, 0.012]), pad.rest_axis, CERTAIN)
    with pytest.raises(ValueError, match="not finite"):
        model.estimate(pad.rest_position_m, pad.rest_axis, CERTAIN * np.nan)


def test_unknown_place_has_the_deviation_of_the_pads_width(model: ContactModel) -> None:
    """Light and noisy poses are moved there; the Jacobian of a network beyond its training is too small."""
    random = np.random.default_rng(5)
    beyond = in_corner = 0
    for _ in range(300):
        position_m = np.array([0.0, 0.0, 12e-3]) + random.normal(0.0, [15e-6, 15e-6, 6e-6])
        tilt = random.normal(0.0, 3e-3, 2)
        axis = np.array([*tilt, np.sqrt(1.0 - tilt @ tilt)])
        for covariance in (np.diag([15e-6, 15e-6, 6e-6, 3e-3, 3e-3, 0.0]) ** 2, CERTAIN):
            estimate = model.estimate(position_m, axis, covariance)
            # No calibrated place is as far from the middle, whichever axis that is along.
            is_far = np.hypot(estimate.x_m, estimate.y_m) > 14e-3 * np.sqrt(2.0)
            for place_m, deviation_m in ((estimate.x_m, estimate.x_sd_m), (estimate.y_m, estimate.y_sd_m)):
                if is_far or abs(place_m) > 14e-3:
                    beyond += 1
                    in_corner += abs(place_m) <= 14e-3
                    assert deviation_m == pytest.approx(28e-3 / np.sqrt(12.0))
    assert beyond > 10
    assert in_corner


def test_light_touch_at_rim_may_be_lighter_one_in_middle(pad: Pad, model: ContactModel) -> None:
    """At three deviations of force they change such a pose alike; a firm press cannot be mistaken."""
    press = np.array([[13.3, 2.8, 0.25], [13.3, 2.8, 1.5]])
    frames = Frames.of(pad, press)
    light, firm = frames.estimates(model)
    noisier = (light.force_n / 3.0 / light.force_sd_n) ** 2
    frames.tracked.covariance[0] *= noisier
    light = frames.estimates(model)[0]
    assert light.force_n > 2.5 * light.force_sd_n
    assert 5.0 * light.x_sd_m > 8e-3
    assert 5.0 * light.y_sd_m > 8e-3
    assert 5.0 * firm.x_sd_m < 2e-3


@pytest.mark.parametrize("refine", [False, True])
@pytest.mark.parametrize("lift_m", [5e-6, 20e-6, 40e-6, 100e-6])
def test_magnet_above_rest_gives_no_contact(pad: Pad, refine: bool, lift_m: float) -> None:
    """A moment that is weaker than assumed looks like that. 20 mN is the answer to a place at rest."""
    raised = pad.rest_position_m + np.array([0.0, 0.0, lift_m])
    assert abs(ContactModel.load("default", pad, refine=refine).estimate(raised, pad.rest_axis, CERTAIN).force_n) < 0.02
