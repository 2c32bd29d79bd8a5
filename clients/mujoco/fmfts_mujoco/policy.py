"""A small policy for FmftsGrasp-v0: sixteen weights, on what the last samples of both pads and the fingers tell."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import numpy as np
from fmfts_client.row import COLUMNS
from numpy.typing import NDArray

from fmfts_mujoco.grasp import OBSERVED, PADS
from fmfts_mujoco.observation import SAMPLES

FEATURES = ("constant", "touched", "force", "weakest", "load", "slipped", "lifted", "closing")
TRAINED = Path(__file__).with_name("models") / "grasp_policy.json"
_AT = {name: number for number, name in enumerate(COLUMNS)}
STALE_S = 0.1  # an older sample does not describe the present


def features(observed: OBSERVED) -> NDArray[np.float64]:
    """The policy's inputs, each of about 1; names explain them."""
    touch, robot = observed["touch"].astype(float), observed["robot"].astype(float)
    usable = (observed["samples"] > 0) & (touch[..., _AT["ok"]] > 0) & (touch[..., _AT["age_s"]] < STALE_S)
    touched = usable & (touch[..., _AT["place_known"]] > 0)
    force_n, load_n, slipped_m = np.zeros(len(PADS)), np.zeros(len(PADS)), np.zeros(len(PADS))
    for pad in range(len(PADS)):
        now = np.flatnonzero(touched[pad])[-4:]
        if len(now):
            seen = touch[pad, now]
            force_n[pad] = seen[:, _AT["force_n"]].mean()
            load_n[pad] = np.hypot(seen[:, _AT["shear_x_n"]], seen[:, _AT["shear_y_n"]]).mean()
            places = touch[pad, touched[pad]][:, [_AT["x_m"], _AT["y_m"]]]
            slipped_m[pad] = np.linalg.norm(places[-1] - places[0])
    return np.array(
        [
            1.0,
            touched[:, -SAMPLES // 2 :].any(axis=1).mean(),
            force_n.mean(),
            force_n.min(),
            load_n.mean(),
            slipped_m.mean() * 1e3,
            robot[2] / 0.06,
            robot[3] / 0.02,
        ]
    )


@dataclass(frozen=True)
class Policy:
    """weights (2, FEATURES): of closing, and of lifting."""

    weights: NDArray[np.float64]

    def __call__(self, observed: OBSERVED) -> NDArray[np.float32]:
        return np.tanh(self.weights @ features(observed)).astype(np.float32)

    @classmethod
    def of(cls, numbers: NDArray[np.float64]) -> Policy:
        return cls(np.asarray(numbers).reshape(2, len(FEATURES)))

    @classmethod
    def load(cls, path: Path = TRAINED) -> Policy:
        return cls(np.array(json.loads(path.read_text())["weights"]))

    def save(self, path: Path) -> None:
        told = {"environment": "FmftsGrasp-v0", "features": FEATURES, "weights": np.round(self.weights, 4).tolist()}
        path.write_text(json.dumps(told, indent=1) + "\n")


@dataclass(frozen=True)
class Episode:
    """How one went.."""

    reward: float
    success: bool
    strongest_n: float
    lifted_m: float


def play(environment: gymnasium.Env, policy: Policy, seed: int) -> Episode:
    """One episode with the object of this seed."""
    observed, _ = environment.reset(seed=seed)
    total, strongest_n, over = 0.0, 0.0, False
    while not over:
        observed, reward, ended, cut, info = environment.step(policy(observed))
        total, over = total + float(reward), ended or cut
        strongest_n = max(strongest_n, float(info["force_n"].max()))
    return Episode(total, bool(info["is_success"]), strongest_n, info["lifted_m"])
