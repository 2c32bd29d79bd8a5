"""Computes the other fields at the sensors: the Earth's as the hand turns, other pads' magnets, and steel."""

from __future__ import annotations

import mujoco
import numpy as np
from fmfts.pad import Array
from fmfts.sensor.chips import TESLA_PER_GAUSS

from fmfts_mujoco.loads import Step
from fmfts_mujoco.places import Places
from fmfts_mujoco.stacked import Stacked

FARTHEST_M = 0.15  # farther magnets add less than twice the noise of one sample


class Surroundings:
    """The fields around K pads. The Earth's field is the model's `<option magnetic>`, in gauss."""

    def __init__(self, model: mujoco.MjModel, places: Places, stacked: Stacked) -> None:
        self._earth_t = model.opt.magnetic * TESLA_PER_GAUSS
        self._steel_m3 = places.steel_m3
        self._stacked = stacked

    def field(self, step: Step, response: Array) -> Array:
        """(K, N, 3) field in pad axes at the sensors, while the magnets moved by `response` (K, 5)."""
        stacked = self._stacked
        field_t = np.broadcast_to((self._earth_t @ step.turn)[:, None], stacked.sensors_m.shape)
        if stacked.pads == 1 and not len(self._steel_m3):
            return field_t
        turn, back = step.turn, step.turn.swapaxes(1, 2)
        places_m = step.origin_m[:, None] + stacked.sensors_m @ back
        position_m, axis = ((each[:, None] @ back)[:, 0] for each in stacked.moved(response))
        position_m = step.origin_m + position_m
        added_t = self._neighbours(step, places_m, position_m, axis)
        if len(self._steel_m3):
            added_t = added_t + self._steel(step.steel_m, places_m, position_m, axis)
        return np.asarray(field_t + added_t @ turn)

    def _neighbours(self, step: Step, places_m: Array, position_m: Array, axis: Array) -> Array:
        """(K, N, 3) field in the world of the magnets of all other pads."""
        added_t = np.zeros_like(places_m)
        apart_m = np.linalg.norm(step.origin_m[:, None] - step.origin_m, axis=-1)
        feels, felt = np.nonzero((apart_m < FARTHEST_M) & ~np.eye(len(apart_m), dtype=bool))
        if len(feels):
            field_t = self._stacked.field_of(felt, places_m[feels], position_m[felt, None], axis[felt, None])
            np.add.at(added_t, feels, field_t)
        return added_t

    def _steel(self, steel_m: Array, places_m: Array, position_m: Array, axis: Array) -> Array:
        """(K, N, 3) field in the world of steel: each geom as a sphere of its volume, magnetised by Earth and pads."""
        pads = np.arange(self._stacked.pads)
        there_t = self._earth_t + np.sum(
            self._stacked.field_of(pads, steel_m, position_m[:, None], axis[:, None]), axis=0
        )
        return np.sum(sphere_field(places_m[:, :, None], steel_m, self._steel_m3[:, None] * there_t), axis=2)


def sphere_field(place_m: Array, centre_m: Array, moment_t_m3: Array) -> Array:
    """Field (…, 3) in tesla of a sphere of µ ≫ 1 in a field B: outside, that of a dipole of moment a³ B.

    moment_t_m3: a³ B. J. D. Jackson, Classical Electrodynamics, 5.11.
    """
    away_m = place_m - centre_m
    distance_m = np.linalg.norm(away_m, axis=-1, keepdims=True)
    along = np.sum(moment_t_m3 * away_m, axis=-1, keepdims=True) / distance_m**2
    return np.asarray((3.0 * along * away_m - moment_t_m3) / distance_m**3)
