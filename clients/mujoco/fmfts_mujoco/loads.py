"""Reads MuJoCo's contacts: place, normal force and shear of each contact on a pad, step by step."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from fmfts.pad import Array

from fmfts_mujoco.places import Places
from fmfts_mujoco.stacked import Stacked


@dataclass(slots=True)
class Step:
    """One step of MuJoCo: where K pads and G geoms of steel were, and what pressed them.

    pads (C, 2): the pads of both geoms of each contact, -1 for none. point_m (C, 3), frame (C, 9), force (C, 6): as
    MuJoCo tells them.
    """

    time_s: float
    origin_m: Array
    turn: Array
    steel_m: Array
    pads: np.ndarray
    point_m: Array
    frame: Array
    force: Array


class Reader:
    """Reads the contacts of one model."""

    def __init__(self, model: mujoco.MjModel, places: Places) -> None:
        self._model, self._places = model, places
        self._none = np.empty((0, 2), dtype=int), np.empty((0, 3)), np.empty((0, 9)), np.empty((0, 6))

    def read(self, data: mujoco.MjData, time_s: float) -> Step:
        """The step that MuJoCo took last. time_s: when it began, for which its contacts hold."""
        contacts = self._contacts(data) if data.ncon else self._none
        return Step(time_s, *self._places.poses(data), data.geom_xpos[self._places.steel], *contacts)

    def _contacts(self, data: mujoco.MjData) -> tuple[np.ndarray, Array, Array, Array]:
        contact = data.contact
        pads = self._places.pad_of_geom[contact.geom]
        on_pads = np.flatnonzero(pads.max(axis=1) >= 0)
        force = np.empty((len(on_pads), 6))
        for row, number in zip(force, on_pads.tolist(), strict=True):
            mujoco.mj_contactForce(self._model, data, number, row)
        return pads[on_pads], contact.pos[on_pads], contact.frame[on_pads], force


@dataclass(slots=True)
class Presses:
    """C presses. step, pad (C,): when and where. load (C, 5): x, y in m, force and shear x, y in N, in pad axes."""

    step: np.ndarray
    pad: np.ndarray
    load: Array

    @classmethod
    def of(cls, steps: list[Step]) -> Presses:
        """All that press a pad during these steps."""
        step_of = np.repeat(np.arange(len(steps)), [len(step.pads) for step in steps])
        pads, point_m, frame, force = (
            np.concatenate([getattr(step, name) for step in steps]) for name in ("pads", "point_m", "frame", "force")
        )
        # MuJoCo gives the force of the first geom on the second one, in the contact's own axes.
        force_n = np.einsum("ci,cij->cj", force[:, :3], frame.reshape(-1, 3, 3))
        first, second = (np.flatnonzero(pads[:, side] >= 0) for side in (0, 1))
        which = np.concatenate([first, second])
        step, pad = step_of[which], np.concatenate([pads[first, 0], pads[second, 1]])
        pushed_n = np.concatenate([-force_n[first], force_n[second]])
        turn = np.array([step.turn for step in steps])[step, pad]
        origin_m = np.array([step.origin_m for step in steps])[step, pad]
        there_m = np.einsum("cij,ci->cj", turn, point_m[which] - origin_m)
        load_n = np.einsum("cij,ci->cj", turn, pushed_n)
        load = np.stack([there_m[:, 0], there_m[:, 1], -load_n[:, 2], load_n[:, 0], load_n[:, 1]], axis=1)
        pressing = load[:, 2] > 0.0  # a force that pulls at a pad, or touches its side, is no press
        return cls(step[pressing], pad[pressing], load[pressing])


def responses(steps: list[Step], stacked: Stacked) -> Array:
    """(S, K, 5) how the magnet of each pad moves at each step: as `MountedPad.response`.

    A press by an area moves a magnet like the mean of presses at its points, each with the whole load
    (fmfts_simulation/finger_shape.py), so contacts count by their shares of the pad's force.
    """
    response = np.zeros((len(steps), stacked.pads, 5))
    presses = Presses.of(steps)
    if not len(presses.pad):
        return response
    at = presses.step, presses.pad
    whole_n = np.zeros((len(steps), stacked.pads, 3))
    np.add.at(whole_n, at, presses.load[:, 2:])
    load_n = whole_n[at]
    moved = stacked.response(presses.pad, presses.load[:, :2], load_n)
    np.add.at(response, at, moved * (presses.load[:, 2] / load_n[:, 0])[:, None])
    return response
