"""The LeRobot package with the real LeRobot of PyPI: `make lerobot` (Python 3.12, with torch 6 GB; ten minutes).

Runs in LeRobot's environment beside a daemon. Records a data set of a simulated pad (`--seconds`, a minute), reads it
back, and compares it with what was observed; then stops the pad's daemon.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.robots import Robot, RobotConfig
from lerobot.utils.feature_utils import build_dataset_frame, hw_to_dataset_features
from lerobot.utils.import_utils import register_third_party_plugins
from lerobot_camera_fmfts import FEATURES, FmftsCameraConfig, Pads, TouchLostError, with_touch

FPS = 30
UNFELT_N = 0.3  # what an untouched pad may read beside three deviations: what is not felt in a corner


class Arm(Robot):
    """A robot with one joint, which is always at rest: what is tried is the touch beside it."""

    name = "arm"
    config_class = RobotConfig
    _connected = False

    is_calibrated = True

    @property
    def observation_features(self) -> dict[str, type]:
        return {"joint.pos": float}

    @property
    def action_features(self) -> dict[str, type]:
        return {"joint.pos": float}

    @property
    def is_connected(self) -> bool:
        return self._connected

    def connect(self, calibrate: bool = True) -> None:
        self._connected = True

    def disconnect(self) -> None:
        self._connected = False

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...

    def get_observation(self) -> dict[str, Any]:
        return {"joint.pos": 0.25}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        return action


def observed_into(data_set: LeRobotDataset, robot: Robot, camera: Any, seconds: float) -> list[np.ndarray]:
    """Each observed state, as it was before the data set had it."""
    states = []
    begun = time.monotonic()
    for number in range(round(seconds * FPS)):
        observation = robot.get_observation() | {"touch": camera.async_read()}
        frame = build_dataset_frame(data_set.features, observation, prefix="observation")
        data_set.add_frame(frame | {"action": np.zeros(1, np.float32), "task": "touch"})
        states.append(frame["observation.state"])
        time.sleep(max(0.0, begun + (number + 1) / FPS - time.monotonic()))
    data_set.save_episode()
    data_set.finalize()
    return states


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seconds", type=float, default=60.0)
    options.add_argument("--daemon", type=int, required=True, help="process id of the daemon, which is stopped at last")
    chosen = options.parse_args()
    register_third_party_plugins()
    with tempfile.TemporaryDirectory() as folder:
        robot = with_touch(Arm(RobotConfig(id="a", calibration_dir=Path(folder))), Pads(["left"]))
        (camera,) = make_cameras_from_configs({"touch": FmftsCameraConfig(pad="left")}).values()
        robot.connect()
        camera.connect()
        hardware = robot.observation_features | {"touch": (camera.height, camera.width, 3)}
        features = hw_to_dataset_features(hardware, "observation", use_video=False)
        features |= hw_to_dataset_features(robot.action_features, "action")
        place = Path(folder, "data")
        data_set = LeRobotDataset.create("lab/touch", FPS, features, root=place, use_videos=False)
        states = observed_into(data_set, robot, camera, chosen.seconds)

        read = LeRobotDataset("lab/touch", root=place)
        names = read.features["observation.state"]["names"]
        assert names == ["joint.pos", *(f"left.{feature}" for feature in FEATURES)], names
        assert len(read) == len(states) == round(chosen.seconds * FPS)
        found = np.stack([np.asarray(read[index]["observation.state"]) for index in range(len(read))])
        np.testing.assert_array_equal(found, np.stack(states))
        assert np.isfinite(found).all()
        force_n, touched = found[:, names.index("left.force_n")], found[:, names.index("left.contact")]
        assert 0.0 < touched.mean() < 1.0, "the scripted finger comes and goes"
        unfelt_n = (force_n - 3.0 * found[:, names.index("left.force_sd_n")])[touched == 0].max()
        assert unfelt_n < UNFELT_N, f"{unfelt_n:.2f} N and more where nothing is felt"
        assert (force_n >= 0.0).all()  # 0 also where the lightest touch is felt
        assert force_n[touched == 1].mean() > UNFELT_N
        pictures = np.stack([np.asarray(read[index]["observation.images.touch"]) for index in range(0, len(read), 10)])
        bright = pictures[:, 0].reshape(len(pictures), -1).max(axis=1) > 0
        print(f"{len(read)} frames, {touched.mean():.0%} touched, up to {force_n.max():.2f} N: read back to the bit")
        assert bright.any()
        assert not bright.all()

        os.kill(chosen.daemon, signal.SIGSTOP)  # silent, and still connected
        time.sleep(0.5)
        for read_something in (robot.get_observation, camera.async_read):
            try:
                for _ in range(3):  # what was on its way when it stopped may still come
                    read_something()
            except TouchLostError as error:
                print(f"raised: {error}")
            else:
                raise AssertionError("a pad that is silent was read")
        os.kill(chosen.daemon, signal.SIGCONT)
        robot.disconnect()
        camera.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
