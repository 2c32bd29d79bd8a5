"""From presses to a model file: samples, training, export."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from fmfts.calibrate.dataset import read_calibration_set
from fmfts.calibrate.evaluation import own_error
from fmfts.calibrate.export import export
from fmfts.calibrate.network import DIRECTION_GAIN, Layers, Problem, features
from fmfts.calibrate.samples import Samples
from fmfts.contact import ContactModel
from fmfts.pad import Pad
from fmfts.simulate.chip import NOISE_T

REST = np.array([0.0, 0.0, 12.0, 0.0, 0.0, 1.0])
HEADER = "x_mm,y_mm,force_n," + ",".join(f"b{sensor}{axis}_ut" for sensor in range(1, 5) for axis in "xyz")


def random_layers(inputs: int, outputs: int, seed: int) -> Layers:
    random = np.random.default_rng(seed)
    sizes = (inputs, 32, 32, outputs)
    weight = [random.standard_normal((m, n)) / np.sqrt(m) for m, n in pairwise(sizes)]
    bias = [random.standard_normal(n) / 10 for n in sizes[1:]]
    return Layers((weight[0], weight[1], weight[2]), (bias[0], bias[1], bias[2]))


def test_poses_are_relative_to_rest(pad: Pad) -> None:
    """The dipole's bias at rest (13.5 µm) is taken out, so an unpressed exact cylinder stands at nominal rest."""
    nothing = np.zeros(1)
    samples = Samples.pressed(pad, (nothing, nothing, nothing), np.random.default_rng(0), 0.0, pad.magnet)
    np.testing.assert_allclose(samples.pose[0], REST, atol=1e-3)  # mm; the frame's stop rule leaves some 0.1 µm


def test_noise_drawn_from_the_covariance_is_that_of_solved_noisy_fields(pad: Pad) -> None:
    """400 draws of each: deviations agree to 3.5 % (1 σ of each), so within 15 %."""
    press = tuple(np.full(400, value) for value in (4e-3, -2e-3, 0.8))
    random = np.random.default_rng(3)
    solved = Samples.pressed(pad, press, random, NOISE_T, pad.magnet)
    once = tuple(values[:1] for values in press)
    drawn = Samples.pressed(pad, once, random, 0.0, pad.magnet).repeated(400, random)
    np.testing.assert_allclose(solved.pose[:, :5].std(axis=0), drawn.pose[:, :5].std(axis=0), rtol=0.15)


def test_bound_grows_as_the_force_falls_and_towards_the_corner(pad: Pad) -> None:
    place, force_n = np.array([2e-3, 2e-3, 12e-3]), np.array([1.6, 0.2, 1.6])
    bound = Samples.pressed(pad, (place, place, force_n), np.random.default_rng(0), 0.0, pad.magnet).bound()
    assert bound[1, 0] / bound[0, 0] == pytest.approx(8.0, rel=0.25)  # in proportion to 1 / force
    assert bound[2, 0] > 4 * bound[0, 0]
    assert bound[0, 2] == pytest.approx(bound[1, 2], rel=0.3)  # the force's hardly changes


def test_two_networks_side_by_side_answer_as_each_alone() -> None:
    place, force = random_layers(10, 2, 1), random_layers(10, 1, 2)
    inputs = np.random.default_rng(3).standard_normal((20, 10))
    together = place.beside(force)(inputs)
    np.testing.assert_allclose(together, np.concatenate([place(inputs), force(inputs)], axis=1), rtol=1e-12)


def test_exported_graph_is_the_trained_network_and_its_exact_derivative(pad: Pad, tmp_path: Path) -> None:
    """Weights at random, many poses in one batch, derivatives against double-precision differences."""
    layers = random_layers(10, 2, 5).beside(random_layers(10, 1, 6))
    facts = ContactModel.load("default", pad).facts
    session = onnxruntime.InferenceSession(export(layers, facts), providers=["CPUExecutionProvider"])
    pose = Samples.drawn(pad, 50, 2.0, seed=8).pose
    contact, jacobian = session.run(None, {"pose": pose.astype(np.float32)})
    np.testing.assert_allclose(contact, layers(features(pose, REST)), atol=2e-3)  # float32 poses: 1 nm in 0.01 mm
    for column, step in enumerate(np.eye(6) * 1e-6):
        slope = (layers(features(pose + step, REST)) - layers(features(pose - step, REST))) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, column], slope, rtol=5e-3, atol=5e-3 * np.abs(slope).max() + 1e-9)


def test_direction_of_a_press_hardly_depends_on_its_force(pad: Pad) -> None:
    place, force_n = np.full(2, 5e-3), np.array([0.5, 1.9])
    poses = Samples.pressed(pad, (place, place, force_n), np.random.default_rng(0), 0.0, pad.magnet).pose
    light, firm = features(poses, REST)[:, 5:] / DIRECTION_GAIN
    assert np.linalg.norm(light - firm) < 0.05
    assert np.linalg.norm(features(REST[None], REST)) == 0.0


def test_training_learns_and_gives_the_same_weights_twice() -> None:
    random = np.random.default_rng(9)
    inputs, judged = random.uniform(-1, 1, (2, 400, 10))

    def target(values: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(2 * values[:, 0]), values[:, 1] * values[:, 2]], axis=1)

    even = np.ones(400)
    problem = Problem(inputs, target(inputs), even, judged, target(judged), even)
    first, errors = problem.train()
    second, _ = problem.train()
    assert errors[-1] < 0.15 * target(judged).std() * np.sqrt(2)
    for one, other in zip(first.weight + first.bias, second.weight + second.bias, strict=True):
        np.testing.assert_array_equal(one, other)


def test_own_error_of_a_biased_model_is_its_bias(pad: Pad) -> None:
    samples = Samples.drawn(pad, 1500, 1.98, seed=10)

    def biased(pose: np.ndarray) -> np.ndarray:
        truth = np.stack([samples.x_m * 1e3, samples.y_m * 1e3, samples.force_n], axis=1)
        return truth + np.array([0.3, -0.2, 0.05])

    facts = own_error(biased, samples)
    np.testing.assert_allclose(facts.x_mm, 0.3, atol=1e-6)
    np.testing.assert_allclose(facts.y_mm, 0.2, atol=1e-6)
    np.testing.assert_allclose(facts.force_error_n, 0.05, atol=1e-6)


def test_calibration_set_without_a_column_is_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "set.csv"
    path.write_text(HEADER.replace("b3y_ut,", "") + "\n" + ",".join(["1"] * 14) + "\n")
    with pytest.raises(ValueError, match="no column b3y_ut"):
        read_calibration_set(path)
