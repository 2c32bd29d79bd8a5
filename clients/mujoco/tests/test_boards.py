"""Frames and messages are those of the daemon's own simulation of the same pad under the same press, to the noise."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from fmfts.pipeline.configured import lead_of
from worlds import WEIGHT_N, pad, pressed, run, world

from fmfts_mujoco import ModelError
from fmfts_mujoco.alike import FRAMES, alike, boards, daemons
from fmfts_mujoco.boards import Boards, built_of
from fmfts_mujoco.stacked import Stacked

PLACE_M = (4e-3, -3e-3)


@pytest.mark.parametrize("seed", [1, 2])
def test_counts_are_those_of_the_daemons_simulation(seed: int) -> None:
    press = (*PLACE_M, 0.8)
    one, other = daemons(pad(seed=seed), press), boards(pad(seed=seed), press)
    assert [frame.sequence for frame in other[: len(one)]] == [frame.sequence for frame in one]
    counts, others = (np.array([frame.counts for frame in frames], dtype=float) for frames in (one, other))
    spread = counts.std(axis=0)
    np.testing.assert_allclose(others.std(axis=0), spread, rtol=0.2)
    assert np.abs(others.mean(axis=0) - counts.mean(axis=0)).max() < (5.0 * spread * np.sqrt(2.0 / FRAMES)).max()


@pytest.mark.parametrize("seed", [1, 2])
def test_messages_are_those_of_the_daemons_simulation(seed: int) -> None:
    """Of 550 frames means scatter by 0.06 of one frame's noise, and a noise by 4 % of the other."""
    apart, noise, deviation = alike(pad(seed=seed), (*PLACE_M, 0.8))
    assert apart.max() < 5 * 0.06
    np.testing.assert_allclose(noise, 1.0, atol=5 * 0.04)
    np.testing.assert_allclose(deviation, 1.0, atol=0.01)


def test_stacked_pads_are_each_of_them() -> None:
    built = [built_of(pad(seed=seed, imperfections=("casting",))) for seed in range(3)]
    stacked = Stacked(built)
    random = np.random.default_rng(0)
    response, field_t = random.normal(0.0, 1e-3, (5, 3, 5)), random.normal(0.0, 1e-4, (5, 3, 4, 3))
    position_m, axis = stacked.moved(response)
    press = random.uniform(0.1, 1.0, (3, 5)) * (5e-3, 5e-3, 1.0, 0.2, 0.2)
    for number, each in enumerate(built):
        for mine, its in zip((position_m, axis), each.moved(response[:, number]), strict=True):
            np.testing.assert_allclose(mine[:, number], its, atol=1e-15)
        np.testing.assert_allclose(stacked.sensed(field_t)[:, number], each.sensed(field_t[:, number]), atol=1e-17)
        found = stacked.response(np.array([number]), press[[number], :2], press[[number], 2:])
        np.testing.assert_allclose(found, each.response(*press[[number]].T), atol=1e-15)


def test_message_reports_the_balls_weight_and_place() -> None:
    model, data, pads = pressed()
    mujoco.mj_resetData(model, data)
    pads.reset(3)
    run(model, data, pads, 1.0)
    told = pads.contacts()["left"]
    assert 215 <= len(told) <= 221
    last = told[-1]
    assert last.health == "ok"
    assert abs(last.force_n - WEIGHT_N) < 2.5 * last.force_sd_n
    assert abs(last.x_m - PLACE_M[0]) < 2.5 * last.x_sd_m
    assert abs(last.y_m - PLACE_M[1]) < 2.5 * last.y_sd_m


def test_message_is_told_no_sooner_than_on_the_robot() -> None:
    model, data, pads = pressed()
    mujoco.mj_resetData(model, data)
    pads.reset(4)
    for _ in range(100):
        run(model, data, pads, 0.001)
        for message in pads.contacts()["left"]:
            assert lead_of(pad()).frame_s <= (message.t_publish_ns - message.t_sample_ns) * 1e-9 < 6e-3
            assert 0 <= pads.now_ns - message.t_publish_ns <= 5_000_000


def test_same_seed_says_the_same() -> None:
    model, data, pads = pressed()
    said = []
    for seed in (5, 5, 6):
        mujoco.mj_resetData(model, data)
        pads.reset(seed)
        run(model, data, pads, 0.3)
        said.append([(each.force_n, each.x_m, each.t_sample_ns) for each in pads.contacts()["left"]])
    assert said[0] == said[1] != said[2]


@pytest.mark.parametrize(
    ("source", "why"),
    [({"imperfections": ("soft_iron",)}, "knows"), ({"warming_k_per_minute": 1.0}, "no warming")],
)
def test_what_cannot_be_simulated_here_is_refused(source: dict[str, object], why: str) -> None:
    with pytest.raises(ModelError, match=why):
        built_of(pad(**source))


def test_pads_of_two_kinds_are_refused() -> None:
    pads = [pad("left"), pad("right", rate_hz=75)]
    with pytest.raises(ModelError, match="differ in rate_hz"):
        Boards(pads, Stacked([built_of(each) for each in pads]))


def test_silicone_creeps() -> None:
    """The magnet goes on sinking under a load that is held: by 2 % in each decade of time."""
    from fmfts_mujoco.scene import Scene

    model = world(PLACE_M)
    data = mujoco.MjData(model)
    scene = Scene(model, [pad(imperfections=("silicone",))])
    z_counts = []
    for step in range(3000):
        mujoco.mj_step(model, data)
        scene.record(data)
        if step in (600, 2999):
            z_counts.append(np.mean([frame.counts[:, 2] for frame in scene.frames()[0][-60:]], axis=0))
    assert np.abs(z_counts[1] - z_counts[0]).max() > 1.0
