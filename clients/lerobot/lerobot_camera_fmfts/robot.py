"""Adds pads to any robot of LeRobot."""

from __future__ import annotations

from typing import Any

from lerobot.robots import Robot

from lerobot_camera_fmfts.touch import Pads


def with_touch(robot: Robot, pads: Pads) -> Robot:
    """The same robot, whose observation also has the floats of `pads`, named `<pad>.<feature>`.

    ValueError: the robot has a feature of that name. `connect` and `disconnect` see to the pads as well.
    """
    taken = pads.features.keys() & robot.observation_features.keys()
    if taken:
        raise ValueError(
            f"the robot has {', '.join(sorted(taken))} already: rename the pads in the daemon's configuration"
        )
    plain = type(robot)

    class Touching(plain):  # type: ignore[misc, valid-type]
        @property
        def observation_features(self) -> dict[str, Any]:
            return {**super().observation_features, **pads.features}

        @property
        def is_connected(self) -> bool:
            return bool(super().is_connected) and pads.is_connected

        def connect(self, *arguments: Any, **options: Any) -> None:
            pads.connect()  # first, because a robot without its touch must not move
            try:
                super().connect(*arguments, **options)
            except BaseException:
                pads.disconnect()
                raise

        def disconnect(self) -> None:
            try:
                super().disconnect()
            finally:
                pads.disconnect()

        def get_observation(self) -> dict[str, Any]:
            return {**super().get_observation(), **pads.read()}

    Touching.__name__ = Touching.__qualname__ = plain.__name__
    robot.__class__ = Touching
    return robot
