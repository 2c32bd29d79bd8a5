"""The pads of fmfts-daemon in MuJoCo: the same messages as on the robot, in process or over the bus."""

from gymnasium.envs.registration import register

from fmfts_mujoco.boards import Faults
from fmfts_mujoco.in_process import Pads
from fmfts_mujoco.over_bus import Robot
from fmfts_mujoco.places import ModelError
from fmfts_mujoco.told import Told

__all__ = ["Faults", "ModelError", "Pads", "Robot", "Told"]

register("FmftsGrasp-v0", entry_point="fmfts_mujoco.grasp:GraspEnv", max_episode_steps=120)
