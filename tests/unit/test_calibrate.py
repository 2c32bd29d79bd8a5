"""From presses to a model file: samples, training, export."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from fmfts.contact import ContactModel
from fmfts.contact.contract import parse_response
from fmfts.contact.response import Response
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.pad import Pad
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import read_calibration_set
from fmfts_calibrate.evaluation import force_bins, own_error, rows, tables_of_squares
from fmfts_calibrate.evaluation_plot import magnification, shortened
from fmfts_calibrate.export import export
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.fitting import fit_response
from fmfts_calibrate.left_out import LeftOut
from fmfts_calibrate.levenberg import Layers, train
from fmfts_calibrate.network import DIRECTION_GAIN, ContactNetwork, features, train_network
from fmfts_calibrate.samples import Samples, presses_in_bins, presses_within
from fmfts_calibrate.selection import Candidate, compare, smallest_within_noise
from fmfts_calibrate.tracked import FrameSolver
from fmfts_calibrate.training import Options, calibrate, selection_table
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of

REST = np.array([0.0, 0.0, 12.0, 0.0, 0.0, 1.0])
SCALE = np.array([0.2, 0.2, 0.6, 0.05, 0.05])
CALIBRATION = Path(__file__).parents[1] / "data" / "calibration_1.23T.csv"


@pytest.fixture
def solver(pad: Pad) -> FrameSolver:
    return FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)


@pytest.fixture(scope="module")
def response() -> Response:
    """The shipped model's."""
    session = onnxruntime.InferenceSession(DEFAULT_PATH, providers=["CPUExecutionProvider"])
    found = parse_response(session.get_modelmeta().custom_metadata_map)
    assert found is not None
    return found


def random_network(hidden: int, outputs: int, seed: int) -> ContactNetwork:
    layers = Layers.drawn((10, hidden, hidden, outputs), np.random.default_rng(seed))
    return ContactNetwork(REST, SCALE, layers)


# --- poses as a tracker finds them ---


@pytest.mark.parametrize("scene", ["drifting", "constant"])
def test_poses_are_relative_to_rest(pad: Pad, scene: str) -> None:
    """The dipole's bias at rest (13.5 µm) is taken out, so an unpressed exact cylinder stands at nominal rest."""
    tracked = FrameSolver(pad, rest_field_of(pad), scene, NOISE_T).solved(rest_field_of(pad)[None])  # type: ignore[arg-type]
    np.testing.assert_allclose(tracked.pose[0], REST, atol=1e-5)  # mm: the stop rule leaves 10 nm


def test_drawn_noise_has_the_covariance_of_solved_frames(pad: Pad, solver: FrameSolver) -> None:
    """400 frames: deviations are known to 3.5 % (1 σ), so they agree within 12 %."""
    press = np.tile([4.0, -2.0, 0.8], (400, 1))
    noise = np.random.default_rng(3).normal(0.0, NOISE_T, (400, 4, 3))
    noisy = solver.solved(pressed_fields(pad, press) + noise)
    clean = solver.solved(pressed_fields(pad, press[:1]))
    np.testing.assert_allclose(noisy.pose[:, :5].std(axis=0), clean.deviation[0], rtol=0.12)
    np.testing.assert_allclose(solver.at(clean.pose).covariance, clean.covariance, rtol=1e-6)


def test_pose_is_the_same_for_any_remanence_of_the_rest_field(pad: Pad) -> None:
    press = np.array([[4.0, -3.0, 1.0], [-10.0, 6.0, 0.5]])
    poses = []
    for remanence_t in (0.6, 1.23, 1.5):
        magnet = pad.magnet.with_remanence(remanence_t)
        solver = FrameSolver(pad, rest_field_of(pad, magnet), "drifting", NOISE_T)
        assert solver.remanence_t == pytest.approx(remanence_t, rel=0.005)  # the dipole's bias is 0.13 %
        poses.append(solver.solved(pressed_fields(pad, press, magnet)).pose)
    for one, other in pairwise(poses):
        np.testing.assert_allclose(one, other, atol=1e-4)  # mm: 0.1 µm


def test_error_bound_grows_for_light_presses_and_corners(response: Response, solver: FrameSolver) -> None:
    press = np.array([[2.0, 2.0, 1.6], [2.0, 2.0, 0.2], [12.0, 12.0, 1.6], [2.0, 2.0, 0.05]])
    bound = Samples.expected(response, solver, press).bound
    assert bound[3, 0] / bound[1, 0] == pytest.approx(4.0, rel=0.05)  # in proportion to 1 / force while it is light
    assert bound[1, 0] / bound[0, 0] > 8.0  # a sinking magnet comes nearer to its sensors, too
    assert bound[2, 0] > 4 * bound[0, 0]
    assert bound[0, 2] == pytest.approx(bound[1, 2], rel=0.3)  # the force's deviation hardly changes


def test_samples_cover_rest_and_slightly_excessive_force(response: Response) -> None:
    press = presses_within(response, 1000, np.random.default_rng(0))
    assert (press[:, 2] == 0.0).sum() == 50
    assert 1.25 * response.scale_n < press[:, 2].max() < 1.31 * response.scale_n
    assert (np.abs(press[:, :2]).max(axis=0) > 13.5).all()


# --- what the fit leaves uncertain ---


def test_error_of_response_from_few_presses_is_known_without_truth(pad: Pad, solver: FrameSolver) -> None:
    """168 of the 675 presses: left-out presses predict the errors to a factor of three (too large, because a fifth of
    so few is missing), and larger ones for fewer presses."""
    calibration = read_calibration_set(CALIBRATION)
    random = np.random.default_rng(3)
    asked = np.column_stack([random.uniform(-13.0, 13.0, (300, 2)), random.uniform(0.3, 1.9, 300)])
    truth = solver.solved(pressed_fields(pad, asked))
    predicted = []
    for every in (2, 4):
        some = np.random.default_rng(1).permutation(675)[::every]
        press, tracked = calibration.press[some], solver.solved(calibration.field_t[some])
        change = tracked.pose[:, :5] - solver.rest_pose[:5]
        left_out = LeftOut.of(press, change, tracked.deviation, 1e-3)
        error = truth.pose[:, :5] - solver.rest_pose[:5]
        error -= fit_response(press, change, tracked.deviation, 1e-3).change(asked)
        expected = np.einsum("kii->ki", left_out.covariance(asked))
        ratio = np.sqrt(np.mean(error**2, axis=0) / np.mean(expected, axis=0))
        assert (ratio < 1.5).all()
        assert (ratio > 0.15).all()
        predicted.append(left_out.in_deviations)
    assert predicted[1] > 1.5 * predicted[0]


@pytest.mark.parametrize("largest_n", [1.0, 12.0])
def test_pad_of_any_force_has_samples_in_each_bin(response: Response, solver: FrameSolver, largest_n: float) -> None:
    """Also a set whose places begin away from its centre: a ring without presses counts like the nearest one."""
    scaled = replace(response, scale_n=largest_n, first_mm=response.first_mm + 20.0)
    bins = force_bins(largest_n)
    press = presses_in_bins(scaled, bins, 50, np.random.default_rng(1))
    assert np.bincount(np.searchsorted(bins, press[:, 2])).tolist() == [50] * len(bins)
    tables = tables_of_squares(bins, press, np.full((len(press), 3), 0.04))
    np.testing.assert_allclose(tables.tables, 0.2)
    assert tables.force_n[-1] == largest_n


def test_response_not_determined_by_presses_is_refused(pad: Pad) -> None:
    calibration = read_calibration_set(CALIBRATION)
    some = np.random.default_rng(1).permutation(675)[:40]
    few = replace(calibration, press=calibration.press[some], field_t=calibration.field_t[some])
    with pytest.raises(DataError, match=r"40 presses do not determine this pad's response: .* deviations"):
        calibrate("few.csv", few, Options(hidden=4), lambda line: None)


# --- networks ---


def test_derivatives_of_the_layers_are_those_of_differences() -> None:
    layers = Layers.drawn((3, 5, 4, 2), np.random.default_rng(1))
    inputs, vector = np.random.default_rng(2).normal(size=(6, 3)), layers.vector()
    slopes = np.stack([slope for _, slope in layers.slopes(inputs)], axis=1)
    for column in range(len(vector)):
        step = np.zeros(len(vector))
        step[column] = 1e-6
        ahead, behind = (layers.with_vector(vector + sign * step)(inputs) for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, :, column], (ahead - behind) / 2e-6, atol=1e-8)


def test_concurrent_networks_answer_as_each_alone() -> None:
    place, force = random_network(8, 2, 1).layers, random_network(8, 1, 2).layers
    inputs = np.random.default_rng(3).standard_normal((20, 10))
    together = place.beside(force)
    np.testing.assert_allclose(together(inputs), np.concatenate([place(inputs), force(inputs)], axis=1), rtol=1e-12)
    assert together.parameters > place.parameters + force.parameters  # the zeros between them count


def test_training_follows_weights_and_gives_same_network_twice() -> None:
    """Contradictory targets: the network answers with the weighted mean, 3 to 1."""
    inputs = np.repeat(np.linspace(-1.0, 1.0, 40)[:, None], 2, axis=0)
    target = np.sin(3.0 * inputs) + np.tile([[0.4], [-0.4]], (40, 1))
    weight = np.tile([[3.0], [1.0]], (40, 1))
    start = Layers.drawn((1, 8, 1), np.random.default_rng(0))
    first, second = (train(start, inputs, target, weight, 100, settled=0.0) for _ in range(2))
    np.testing.assert_allclose(first(inputs), np.sin(3.0 * inputs) + 0.2, atol=0.01)
    np.testing.assert_array_equal(first.vector(), second.vector())


def test_direction_of_a_press_hardly_depends_on_its_force(response: Response) -> None:
    change = response.change(np.array([[5.0, 5.0, 0.5], [5.0, 5.0, 1.9]]))
    poses = REST + np.column_stack([change, np.zeros(2)])
    light, firm = features(poses, REST, SCALE)[:, 5:] / DIRECTION_GAIN
    assert np.linalg.norm(light - firm) < 0.05
    assert np.linalg.norm(features(REST[None], REST, SCALE)) == 0.0


@pytest.mark.parametrize("outputs", [3, 5])
def test_exported_graph_is_the_network_and_its_exact_derivative(pad: Pad, response: Response, outputs: int) -> None:
    """Weights at random, many poses in one batch, derivatives against double-precision differences."""
    network = random_network(8, outputs, 5)
    facts = ContactModel.load("default", pad).facts
    content = export(network, facts, response)
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    pose = REST + np.random.default_rng(6).normal(size=(50, 6)) * [0.05, 0.05, 1.0, 0.05, 0.05, 0.0]
    contact, jacobian = session.run(None, {"pose": pose.astype(np.float32)})
    np.testing.assert_allclose(contact, network(pose), atol=2e-3)  # float32 poses: 1 nm in 0.01 mm
    for column, step in enumerate(np.eye(6) * 1e-6):
        slope = (network(pose + step) - network(pose - step)) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, column], slope, rtol=5e-3, atol=5e-3 * np.abs(slope).max() + 1e-9)
    packed = parse_response(session.get_modelmeta().custom_metadata_map)
    assert packed is not None
    np.testing.assert_array_equal(packed.coefficient, response.coefficient)


# --- selection and reports ---


def test_larger_networks_that_gain_nothing_are_not_chosen() -> None:
    def candidate(hidden: int, *score: float) -> Candidate:
        return Candidate(str(hidden), hidden, hidden**2, np.array(score))

    ladder = [candidate(6, 1.5, 1.6, 1.55), candidate(12, 1.011, 1.009, 1.01), candidate(24, 1.0, 1.0, 1.0)]
    assert smallest_within_noise(ladder).hidden == 12
    ladder[1] = replace(ladder[1], score=np.array([1.1, 1.1, 1.1]))
    assert smallest_within_noise(ladder).hidden == 24
    ladder[2] = replace(ladder[2], score=np.array([0.8, 1.0, 1.2]))  # the folds differ by more than the gain
    assert smallest_within_noise(ladder).hidden == 12


def test_network_table_states_its_rule_and_rejections() -> None:
    ladder = [
        Candidate("two layers of 12", 12, 50, np.full(3, 1.16)),
        Candidate("table inversion", None, 9, np.ones(3)),
    ]
    table = selection_table(ladder, smallest_within_noise(ladder))
    assert re.search(r"table inversion .* -13\.8%\n", table)
    assert "the smallest network within 2%" in table
    assert "the daemon runs networks alone" in table


def test_folds_and_steps_that_are_done_are_shown(response: Response, solver: FrameSolver) -> None:
    shares: list[float] = []
    clean = Samples.expected(response, solver, presses_within(response, 300, np.random.default_rng(1)))
    train_network(clean, REST, 4, steps=5, done=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) == 10


def test_arrows_near_the_centre_are_long_enough_to_see() -> None:
    random = np.random.default_rng(1)
    press = np.column_stack([random.uniform(-20, 20, (400, 2)), random.uniform(0.1, 1.7, 400)])
    central = np.hypot(press[:, 0], press[:, 1]) <= 11.0
    error = random.normal(0.0, 1.0, (400, 2)) * np.where(central, 0.05, 3.0)[:, None]
    drawn, cut = shortened(magnification(press, error) * error)
    assert np.median(np.hypot(*drawn[central].T)) > 0.5
    assert np.hypot(*drawn.T).max() <= 4.0 + 1e-9
    assert not cut[central].any()
    assert cut[~central].mean() > 0.5


@pytest.mark.long
def test_left_out_presses_reject_too_small_networks(pad: Pad) -> None:
    """Half of the calibration set, two sizes: a frame's noise allows 1, so a score of 1 is as good as can be."""
    calibration = read_calibration_set(CALIBRATION)
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    some = np.arange(0, 675, 2)
    tracked = solver.solved(calibration.field_t[some])
    found = {one.name: one for one in compare(solver, calibration.press[some], tracked, 1e-3, (2, 8), presses=600)}
    assert 0.9 < found["table inversion"].mean < 1.3
    assert found["table inversion"].mean < found["two layers of 8"].mean < found["two layers of 2"].mean
    assert smallest_within_noise(list(found.values())).hidden == 8


def test_own_error_of_a_biased_model_is_its_bias(response: Response, solver: FrameSolver) -> None:
    press = presses_within(response, 3000, np.random.default_rng(10), beyond=1.0)
    samples = Samples.expected(response, solver, press)
    bias = np.array([0.3, -0.2, 0.05])
    bins = force_bins(response.scale_n)
    facts = own_error(lambda pose: press + bias, samples, samples, bins)
    np.testing.assert_allclose(facts.x_mm, 0.3, atol=1e-5)
    np.testing.assert_allclose(facts.y_mm, 0.2, atol=1e-5)
    np.testing.assert_allclose(facts.force_error_n, 0.05, atol=1e-5)


def test_model_error_excludes_propagated_pose_errors(response: Response, solver: FrameSolver) -> None:
    samples = Samples.expected(response, solver, presses_within(response, 3000, np.random.default_rng(10), beyond=1.0))
    noisy, still = samples.noisy(1, np.random.default_rng(11)), samples.pose
    bins = force_bins(response.scale_n)

    def linear(pose: np.ndarray) -> np.ndarray:
        return np.asarray(samples.press + np.column_stack([pose[:, :2] - still[:, :2], np.zeros(len(pose))]))

    deviation = np.sqrt(samples.covariance[:, 0, 0].max())
    # Of 50 in a bin, the mean of e² − σ² scatters by √(2/50) σ²: half of the bins have √0.2 σ, the others nothing.
    assert np.mean(own_error(linear, samples, noisy, bins).x_mm) < 0.4 * deviation
    shifted = replace(noisy, press=np.add(samples.press, [5.0 * deviation, 0.0, 0.0]))
    assert np.min(own_error(linear, samples, shifted, bins).x_mm) > 4.0 * deviation


def test_rows_of_an_evaluation_are_the_errors_of_their_regions() -> None:
    press = np.array([[0.0, 0.0, 1.0], [12.0, 5.0, 0.3], [0.0, 9.0, 1.5]])
    found = press + np.array([[0.1, 0.0, 0.0], [-0.4, 0.2, 0.1], [0.1, 0.1, -0.2]])
    table = {row["region"]: row for row in rows(press, found, np.full((3, 3), 0.1))}
    assert table["all"]["mae_x_mm"] == pytest.approx(0.2)
    assert table["all"]["rmse_force_n"] == pytest.approx(np.sqrt(0.05 / 3.0), abs=1e-5)
    assert table["beyond 11 mm"]["mae_y_mm"] == pytest.approx(0.2)
    assert table["8 to 11 mm"]["in_sd_force_n"] == pytest.approx(2.0)
    assert table["within 8 mm"]["presses"] == 1


def test_training_a_small_model_gives_the_same_weights_twice(response: Response, solver: FrameSolver) -> None:
    random = np.random.default_rng(4)
    samples = Samples.expected(response, solver, presses_within(response, 400, random)).noisy(1, random)
    first, second = (train_network(samples, REST, 4, steps=5) for _ in range(2))
    np.testing.assert_array_equal(first.layers.vector(), second.layers.vector())
