"""The LeRobot package with the real LeRobot of PyPI: `make lerobot` (Python 3.12, with torch 6 GB; ten minutes).

Runs in LeRobot's environment beside a daemon. Records a data set of a simulated pad (`--seconds`, a minute), reads it
back, and compares it with the observations; then stops the pad's daemon.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.robots import Robot, RobotConfig
from lerobot.utils.feature_utils import build_dataset_frame, hw_to_dataset_features
from lerobot.utils.import_utils import register_third_party_plugins
from lerobot_camera_fmfts import FEATURES, FmftsCameraConfig, Pads, Samples, TouchLostError, with_touch

from fmfts_client import Subscription
from fmfts_client.row import COLUMNS

FPS = 30
TACTILE, PARTS = "observation.tactile.left", ("", ".sd", ".age_s", ".samples", ".mask", ".stamps_ns", ".left_out")
PATIENCE_S = 2.0  # other programs may occupy both cores for this long
UNFELT_N = 0.3  # an untouched pad may read this beyond three deviations: too little to detect in a corner


class Arm(Robot):
    """A robot with one joint, always at rest: the test concerns the touch beside it."""

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


def observed_into(
    data_set: LeRobotDataset, robot: Robot, camera: Any, samples: Samples, seconds: float
) -> list[dict[str, np.ndarray]]:
    """The state and the arrays of each step, as observed before they entered the data set."""
    steps = []
    begun = time.monotonic()
    for number in range(round(seconds * FPS)):
        observation = robot.get_observation() | {"touch": camera.async_read(1e3 * PATIENCE_S)}
        frame = build_dataset_frame(data_set.features, observation, prefix="observation") | samples.frame()
        data_set.add_frame(frame | {"action": np.zeros(1, np.float32), "task": "touch"})
        steps.append({key: value for key, value in frame.items() if key != "observation.images.touch"})
        time.sleep(max(0.0, begun + (number + 1) / FPS - time.monotonic()))
    data_set.save_episode()
    data_set.finalize()
    return steps


@contextmanager
def published() -> Iterator[dict[int, tuple[int, int]]]:
    """What a second subscriber receives meanwhile: for each message's number the time of its sample, on the daemon's
    clock, which reveals repeated ones, and as UTC."""
    heard_ns: dict[int, tuple[int, int]] = {}
    ended = threading.Event()

    def listen() -> None:
        with Subscription(("contact",), "left") as messages:
            while not ended.is_set():
                if (message := messages.receive(0.1)) is not None:
                    body = message.body
                    sampled_ns = body["t_sample_ns"]
                    heard_ns[body["seq"]] = sampled_ns, body["utc_ns"] - (body["t_publish_ns"] - sampled_ns)

    listener = threading.Thread(target=listen)
    listener.start()
    try:
        while not heard_ns:  # until it is connected
            time.sleep(0.01)
        yield heard_ns
    finally:
        time.sleep(0.5)
        ended.set()
        listener.join()


def every_sample_is_there(steps: list[dict[str, np.ndarray]], heard_ns: dict[int, tuple[int, int]]) -> str:
    """Each sample must occur once and in order, skipped ones must be counted, and the wrench must be that of the
    newest."""
    step = {part: np.stack([each[f"{TACTILE}{part}"] for each in steps]) for part in PARTS}
    mask, newest = step[".mask"], step[".samples"][:, -1]
    stamps_ns = step[".stamps_ns"][mask]
    assert (np.diff(stamps_ns) > 0).all()
    # Starting at the newest sample of the first step with one, `left_out` counts each number that no step contains.
    begun = int(mask[:, -1].argmax())
    number_of = {utc_ns: seq for seq, (_, utc_ns) in heard_ns.items()}
    first, last = number_of[int(step[".stamps_ns"][begun, -1])], number_of[int(stamps_ns[-1])]
    meanwhile = {seq: heard for seq, heard in sorted(heard_ns.items()) if first <= seq <= last}
    samples = dict(reversed(meanwhile.values()))  # the first of the messages that repeat a sample
    told = int(step[".left_out"][begun + 1 :].sum())
    missing = len(set(samples.values()) - set(stamps_ns.tolist()))
    held_back = last - first + 1 - len(meanwhile)  # numbered, and by then too old to be published
    assert told == missing + held_back, f"{missing} + {held_back} samples are missing, and `left_out` says {told}"
    assert not step[".samples"][~mask].any(), "zero where there is no sample"
    assert (step[".age_s"] <= PATIENCE_S).all()
    # After a pause the first frames may be ok while their force is still unknown: the wrench is then the last known
    # one.
    ok = mask[:, -1] & (newest[:, COLUMNS.index("ok")] == 1) & (newest[:, COLUMNS.index("force_sd_n")] > 0)
    np.testing.assert_array_equal(-step[""][ok, 0, 2], newest[ok, COLUMNS.index("force_n")])
    placed = ok & (newest[:, COLUMNS.index("place_known")] == 1) & (newest[:, COLUMNS.index("contact")] == 1)
    y_m = newest[placed, COLUMNS.index("y_m")]
    np.testing.assert_allclose(step[""][placed, 0, 3], y_m * step[""][placed, 0, 2], atol=1e-9)  # no shear is known
    assert (step[".sd"][ok, 0, 2] > 0).all()
    largest = mask.sum(axis=1).max()
    empty, oldest_s = int((~mask[:, -1]).sum()), float(step[".age_s"].max())
    repeated = len(meanwhile) - len(samples)
    return (
        f"{mask.sum()} samples in {len(steps)} steps, {largest} at most in one; {told} left out, and told so: "
        f"{missing} published, {held_back} never ({repeated} repeated). {empty} steps had none; the oldest wrench was "
        f"{oldest_s:.2f} s old"
    )


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seconds", type=float, default=60.0)
    options.add_argument("--daemon", type=int, required=True, help="process id of the daemon, which is stopped at last")
    chosen = options.parse_args()
    register_third_party_plugins()
    with tempfile.TemporaryDirectory() as folder:
        robot = with_touch(
            Arm(RobotConfig(id="a", calibration_dir=Path(folder))), Pads(["left"], patience_s=PATIENCE_S)
        )
        (camera,) = make_cameras_from_configs({"touch": FmftsCameraConfig(pad="left")}).values()
        robot.connect()
        camera.connect()
        samples = Samples(["left"], patience_s=PATIENCE_S)
        hardware = robot.observation_features | {"touch": (camera.height, camera.width, 3)}
        features = hw_to_dataset_features(hardware, "observation", use_video=False)
        features |= hw_to_dataset_features(robot.action_features, "action") | samples.features
        place = Path(folder, "data")
        data_set = LeRobotDataset.create("lab/touch", FPS, features, root=place, use_videos=False)
        with published() as heard_ns:
            samples.connect()
            steps = observed_into(data_set, robot, camera, samples, chosen.seconds)

        read = LeRobotDataset("lab/touch", root=place)
        names = read.features["observation.state"]["names"]
        assert names == ["joint.pos", *(f"left.{feature}" for feature in FEATURES)], names
        assert len(read) == len(steps) == round(chosen.seconds * FPS)
        items = [read[index] for index in range(len(read))]
        for key in steps[0]:
            written, back = np.stack([step[key] for step in steps]), np.stack([np.asarray(item[key]) for item in items])
            np.testing.assert_array_equal(back.reshape(written.shape), written, err_msg=key)
            assert back.dtype == written.dtype, f"{key}: {written.dtype} came back as {back.dtype}"
            assert np.isfinite(written).all(), key
        print(every_sample_is_there(steps, heard_ns))
        found = np.stack([step["observation.state"] for step in steps])
        force_n, touched = found[:, names.index("left.force_n")], found[:, names.index("left.contact")]
        assert 0.0 < touched.mean() < 1.0, "the scripted finger comes and goes"
        unfelt_n = (force_n - 3.0 * found[:, names.index("left.force_sd_n")])[touched == 0].max()
        assert unfelt_n < UNFELT_N, f"{unfelt_n:.2f} N and more where nothing is felt"
        assert (force_n >= 0.0).all()  # 0 even where the lightest touch is detected
        assert force_n[touched == 1].mean() > UNFELT_N
        pictures = np.stack([np.asarray(read[index]["observation.images.touch"]) for index in range(0, len(read), 10)])
        bright = pictures[:, 0].reshape(len(pictures), -1).max(axis=1) > 0
        print(f"{len(read)} frames, {touched.mean():.0%} touched, up to {force_n.max():.2f} N: read back to the bit")
        assert bright.any()
        assert not bright.all()

        os.kill(chosen.daemon, signal.SIGSTOP)  # silent, but still connected
        time.sleep(0.5)
        for read_something in (robot.get_observation, camera.async_read, samples.frame):
            begun_s = time.monotonic()
            try:
                while time.monotonic() - begun_s < 3.0 * PATIENCE_S:  # messages sent before it stopped may still come
                    read_something()
                    time.sleep(1.0 / FPS)
            except TouchLostError as error:
                print(f"raised after {time.monotonic() - begun_s:.1f} s: {error}")
            else:
                raise AssertionError("a pad that is silent was read")
        os.kill(chosen.daemon, signal.SIGCONT)
        robot.disconnect()
        camera.disconnect()
        samples.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
