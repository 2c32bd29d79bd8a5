"""FmftsGrasp-v0: two fingers with a pad each lift an object of unknown weight and friction, and do not crush it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from fmfts.baseline import Baseline
from fmfts.config.file import load
from fmfts_client.row import COLUMNS
from gymnasium import spaces
from numpy.typing import NDArray

from fmfts_mujoco.in_process import Pads
from fmfts_mujoco.observation import LARGEST, SAMPLES, Window
from fmfts_mujoco.over_bus import Robot
from fmfts_mujoco.scene import Scene
from fmfts_mujoco.setting_up import baselines

MODELS = Path(__file__).with_name("models")
CONFIG = MODELS / "gripper.toml"
PADS = ("left_pad", "right_pad")
CONTROL_S = 0.02
CLOSING_M_PER_S, LIFTING_M_PER_S = 0.04, 0.1
MASS_KG, FRICTION, WIDER_M = (0.02, 0.05), (0.3, 0.6), (-0.003, 0.003)
CRUSHED_N = 2.0  # force of either finger in one step of control; holding an object takes 0.16 to 0.82 N
LIFTED_M = 0.04
OBSERVED = dict[str, NDArray[Any]]


class GraspEnv(gymnasium.Env[OBSERVED, NDArray[np.float32]]):
    """Observation: `touch` (2, SAMPLES, columns) of the last messages; `samples`, 1 where there is one; `robot`: the
    way of both fingers and of the lift in m, and the targets of both. Action: how fast to close, and to lift."""

    metadata = {"render_modes": [], "render_fps": 50}  # noqa: RUF012

    def __init__(
        self, config: Path | str | None = None, endpoint: str | None = None, *, as_built: bool = False
    ) -> None:
        """config: of a daemon that runs, and takes its frames from here, in real time; None: all in this process.
        as_built: pads that are mounted as a hand does, with other silicone and fingertips: in each episode, or where a
        daemon reads them once."""
        self.model = mujoco.MjModel.from_xml_path(str(MODELS / "gripper.xml"))
        self.data = mujoco.MjData(self.model)
        self.pads: Pads | Robot
        if config is None:
            self.pads = Pads(self.model, self.data, CONFIG, _baselines(as_built), as_built=as_built)
        else:
            self.pads = Robot(self.model, self.data, config, endpoint, as_built=as_built)
        shape = (len(PADS), SAMPLES)
        self.observation_space = spaces.Dict(
            {
                "touch": spaces.Box(-LARGEST, LARGEST, (*shape, len(COLUMNS)), np.float32),
                "samples": spaces.Box(0, 1, shape, np.int8),
                "robot": spaces.Box(-1.0, 1.0, (5,), np.float32),
            }
        )
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._substeps = round(CONTROL_S / self.model.opt.timestep)
        self._object = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, "object")
        self._cheeks = [self.model.geom(name).id for name in ("left_cheek", "right_cheek")]
        self._fingers = [self.model.body(name).id for name in ("left", "right")]
        self._finger_m = self.model.body_pos[self._fingers].copy()
        self._mass_kg = self.model.body_mass[self._object]
        self._inertia = self.model.body_inertia[self._object].copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[OBSERVED, dict[str, Any]]:
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self._draw()
        mujoco.mj_forward(self.model, self.data)
        self.pads.reset(self.np_random)
        self._windows = [Window() for _ in PADS]
        self._target_m = np.zeros(2)
        self._start_m = float(self.data.xpos[self._object, 2])
        self._strongest_n, self._lifted_m = 0.0, 0.0
        self._run()
        return self._observed(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[OBSERVED, float, bool, bool, dict[str, Any]]:
        rate = np.clip(np.asarray(action, dtype=float), -1.0, 1.0) * (CLOSING_M_PER_S, LIFTING_M_PER_S)
        self._target_m = np.clip(self._target_m + rate * CONTROL_S, 0.0, (0.045, 0.12))
        self.data.ctrl[:] = *2 * (self._target_m[0],), self._target_m[1]
        force_n, before_m = self._run(), self._lifted_m
        self._strongest_n = max(self._strongest_n, float(force_n.max()))
        self._lifted_m = min(float(self.data.xpos[self._object, 2]) - self._start_m, 1.5 * LIFTED_M)
        crushed = self._strongest_n > CRUSHED_N
        reward = (self._lifted_m - before_m) / LIFTED_M - 0.005 * float(force_n.mean()) - 2.0 * crushed
        info = {
            "is_success": self._lifted_m > LIFTED_M and not crushed,
            "crushed": crushed,
            "force_n": force_n,
            "lifted_m": self._lifted_m,
        }
        return self._observed(), reward, crushed, False, info

    def close(self) -> None:
        if isinstance(self.pads, Robot):
            self.pads.close()

    def _draw(self) -> None:
        """Another object."""
        mass_kg, friction, wider_m = (self.np_random.uniform(*limits) for limits in (MASS_KG, FRICTION, WIDER_M))
        self.model.body_mass[self._object] = mass_kg
        self.model.body_inertia[self._object] = self._inertia * mass_kg / self._mass_kg
        self.model.geom_friction[self._cheeks, 0] = friction
        # MuJoCo does not notice that a geom of the object was moved, so the fingers start nearer to it.
        nearer_m = np.outer(np.sign(self._finger_m[:, 0]), (wider_m, 0.0, 0.0))
        self.model.body_pos[self._fingers] = self._finger_m - nearer_m
        self.data.joint("object").qpos[1] += self.np_random.uniform(-0.003, 0.003)

    def _run(self) -> NDArray[np.float64]:
        """One step of control. Returns the mean force (2,) on the pads during it."""
        force_n = np.zeros(2)
        for _ in range(self._substeps):
            mujoco.mj_step(self.model, self.data)
            self.pads.step(self.data)
            force_n += self.data.sensordata
        return force_n / self._substeps

    def _observed(self) -> OBSERVED:
        contacts = self.pads.contacts()
        for window, name in zip(self._windows, PADS, strict=True):
            window.add(contacts[name])
        touch, samples = zip(*(window.at(self.pads.now_ns) for window in self._windows), strict=True)
        ways = (self.data.joint(name).qpos[0] for name in ("left", "right", "lift"))
        robot = np.array([*ways, *self._target_m], dtype=np.float32)
        return {"touch": np.stack(touch), "samples": np.stack(samples), "robot": robot}


@cache
def _baselines(as_built: bool) -> dict[str, Baseline]:
    """Recorded once for all environments of this process."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "gripper.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return baselines(Scene(model, load(CONFIG)[0].pad, as_built=as_built), data)
