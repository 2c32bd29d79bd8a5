"""MuJoCo feeds a real daemon: its clients read what they would read of a robot."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import mujoco
import pytest
from fmfts_client import Client, Contact
from worlds import WEIGHT_N, world

from fmfts_mujoco import ModelError, Robot
from fmfts_mujoco.daemon import Daemon

CONFIG = '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\nframes_from = "left.sock"\n'


def test_client_reads_the_balls_weight_and_a_fault(tmp_path: Path) -> None:
    config = tmp_path / "pads.toml"
    config.write_text(CONFIG)
    model = world((4e-3, -3e-3))
    data = mujoco.MjData(model)
    with Daemon(config) as daemon:
        robot = Robot(model, data, daemon.config, daemon.endpoint)
        daemon.start(robot)
        with Client("left", daemon.endpoint) as client:
            told = drive(robot, model, data, client, 3.0)
            held = [each for each in told if each.valid and each.contact]
            assert len(held) > 100, told[-1].reason  # a busy computer loses some messages
            assert abs(held[-1].force_n - WEIGHT_N) < 3.0 * held[-1].force_sd_n
            assert abs(held[-1].x_m - 4e-3) < 3.0 * held[-1].x_sd_m
            assert 0 < held[-1].t_publish_ns - held[-1].t_sample_ns < 100_000_000
            assert robot.contacts()["left"]
            robot.faults["left"].silent.add(2)
            assert "degraded" in {each.health for each in drive(robot, model, data, client, 1.0)}
            time.sleep(1.5)  # the simulator hangs
            told = list(client.contacts(0.0))
            assert told[-1].health == "disconnected"
            assert "does the simulator run" in told[-1].reason
        robot.close()


def drive(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData, client: Client, seconds: float) -> list[Contact]:
    """The messages that the client receives meanwhile."""
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        robot.step(data)
    return list(client.contacts(0.0))


def test_robot_without_a_daemon_goes_on(tmp_path: Path) -> None:
    config = tmp_path / "pads.toml"
    config.write_text(CONFIG)
    model = world()
    data = mujoco.MjData(model)
    robot = Robot(model, data, config, f"ipc://{tmp_path}")
    begun_s = time.monotonic()
    for _ in range(100):
        mujoco.mj_step(model, data)
        robot.step(data)
    assert time.monotonic() - begun_s >= 0.098
    assert robot.unsent >= 20
    assert robot.contacts() == {"left": []}
    robot.close()


def test_same_seed_builds_the_same_pads_with_the_same_noise(tmp_path: Path) -> None:
    config = tmp_path / "pads.toml"
    config.write_text(CONFIG)
    model = world()
    made = []
    for seed in (3, 3, 4):
        data = mujoco.MjData(model)
        robot = Robot(model, data, config, f"ipc://{tmp_path}", as_built=True, seed=seed)
        for _ in range(20):
            mujoco.mj_step(model, data)
            robot.scene.record(data)
        counts = [frame.counts.tolist() for frame in robot.scene.frames()[0]]
        assert counts
        structures = robot.scene.stacked.structures
        assert structures is not None
        made.append((float(structures.modulus[0]), counts))
        robot.close()
    assert made[0] == made[1]
    assert made[0][0] != made[2][0]
    assert made[0][1] != made[2][1]


def test_full_socket_does_not_block_the_simulation(tmp_path: Path) -> None:
    """A daemon that hangs: its socket takes some frames, and then none."""
    config = tmp_path / "pads.toml"
    config.write_text(CONFIG)
    model = world()
    data = mujoco.MjData(model)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as hanging:
        hanging.bind(str(tmp_path / "left.sock"))
        robot = Robot(model, data, config, f"ipc://{tmp_path}")
        for _ in range(400):
            mujoco.mj_step(model, data)
            robot.step(data)
        assert 0 < robot.unsent < 88
        robot.close()


def test_pad_that_takes_no_frames_is_an_error(tmp_path: Path) -> None:
    config = tmp_path / "pads.toml"
    config.write_text(CONFIG.replace('frames_from = "left.sock"\n', ""))
    model = world()
    with pytest.raises(ModelError, match="needs frames_from"):
        Robot(model, mujoco.MjData(model), config)
