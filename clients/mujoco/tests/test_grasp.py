"""FmftsGrasp-v0: an environment as Gymnasium wants it, several at once, and what its observation holds."""

from __future__ import annotations

from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest
from fmfts_client.row import COLUMNS
from gymnasium.utils.env_checker import check_env

from fmfts_mujoco.grasp import GraspEnv
from fmfts_mujoco.observation import SAMPLES, Window
from fmfts_mujoco.policy import FEATURES, Policy, features, play
from fmfts_mujoco.told import Told

CLOSE, LIFT = np.array([1.0, 0.0]), np.array([0.0, 1.0])


@pytest.fixture(scope="module")
def environment() -> Iterator[gymnasium.Env]:
    made = gymnasium.make("FmftsGrasp-v0")
    yield made
    made.close()


def test_gymnasium_finds_nothing_wrong(environment: gymnasium.Env) -> None:
    check_env(environment.unwrapped, skip_render_check=True)


def test_several_at_once_are_each_of_them(environment: gymnasium.Env) -> None:
    several = gymnasium.make_vec("FmftsGrasp-v0", num_envs=2, vectorization_mode="sync")
    observed, _ = several.reset(seed=[3, 4])
    for _ in range(20):
        observed, *_ = several.step(np.tile(CLOSE, (2, 1)).astype(np.float32))
    alone, _ = environment.reset(seed=4)
    for _ in range(20):
        alone, *_ = environment.step(CLOSE)
    for name, value in alone.items():
        np.testing.assert_allclose(observed[name][1], value, rtol=1e-6, atol=1e-9)
    several.close()


def test_samples_fill_the_window_and_grow_no_older(environment: gymnasium.Env) -> None:
    observed, _ = environment.reset(seed=1)
    assert observed["touch"].shape == (2, SAMPLES, len(COLUMNS))
    assert 3 <= observed["samples"][0].sum() <= 5  # samples of 20 ms at 220 Hz
    np.testing.assert_array_equal(observed["touch"][observed["samples"] == 0], 0.0)
    for _ in range(5):
        observed, *_ = environment.step(np.zeros(2))
    assert observed["samples"].all()
    age_s = observed["touch"][0, :, COLUMNS.index("age_s")]
    assert np.all(np.diff(age_s) < 0.0)
    assert 0.0 < age_s[-1] < 0.012


def test_squeezing_without_end_crushes(environment: gymnasium.Env) -> None:
    environment.reset(seed=1)
    ended, steps = False, 0
    while not ended:
        observed, _, ended, _, info = environment.step(CLOSE)
        steps += 1
    assert info["crushed"]
    assert not info["is_success"]
    assert steps < 60
    forces_n = observed["touch"][:, -1, COLUMNS.index("force_n")]
    np.testing.assert_allclose(forces_n, info["force_n"], rtol=0.3)


def test_lifting_without_holding_is_no_success(environment: gymnasium.Env) -> None:
    environment.reset(seed=1)
    for _ in range(60):
        _, _, _, _, info = environment.step(LIFT)
    assert info["lifted_m"] < 1e-3
    assert not info["is_success"]


def test_objects_differ_and_one_seed_is_one_object(environment: gymnasium.Env) -> None:
    whole = environment.unwrapped
    assert isinstance(whole, GraspEnv)
    drawn = []
    for seed in (1, 2, 1):
        environment.reset(seed=seed)
        model = whole.model
        drawn.append((model.body_mass.copy(), model.geom_friction.copy(), model.body_pos.copy()))
    for one, other in zip(drawn[0], drawn[2], strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(drawn[0][0], drawn[1][0])


def test_trained_policy_lifts_what_it_never_saw(environment: gymnasium.Env) -> None:
    episodes = [play(environment, Policy.load(), seed) for seed in range(20)]
    assert sum(each.success for each in episodes) >= 18


def test_blind_policy_does_not(environment: gymnasium.Env) -> None:
    """The pads' messages matter: without them the same policy crushes the object, or holds nothing."""
    policy = Policy.load()

    def blind(observed: dict[str, np.ndarray]) -> np.ndarray:
        return policy({**observed, "samples": np.zeros_like(observed["samples"])})

    episodes = [play(environment, blind, seed) for seed in range(5)]
    assert sum(each.success for each in episodes) == 0


def test_policy_is_kept(tmp_path: object) -> None:
    path = tmp_path / "policy.json"  # type: ignore[operator]
    policy = Policy.of(np.arange(2.0 * len(FEATURES)))
    policy.save(path)
    np.testing.assert_allclose(Policy.load(path).weights, policy.weights)


def test_unknown_sample_is_zero_not_nan() -> None:
    window = Window()
    window.add(Told())
    touch, samples = window.at(1_000_000_000)
    assert not touch.any()
    assert not samples.any()
    observed = {"touch": np.stack([touch] * 2), "samples": np.stack([samples] * 2), "robot": np.zeros(5)}
    np.testing.assert_array_equal(features(observed), [1.0] + [0.0] * (len(FEATURES) - 1))
