"""Finds the pads in a MuJoCo model: each is a site or a geom that has the pad's name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts_simulation.imperfections import TOP_M

STEEL = "steel"  # the material of geoms that an ambient field and magnets magnetise


class ModelError(ValueError):
    """The MuJoCo model lacks what the configuration needs; the text says what."""


@dataclass(frozen=True)
class Places:
    """Where K pads are in a model.

    site, geom (K,): its number in the model, -1 where the pad is the other one. below_m (K,): how far the origin of the
    pad's axes is below the site or geom. pad_of_geom (ngeom,): which pad a contact on a geom presses, or -1.
    steel (G,): geoms of steel; steel_m3 (G,): the cube of the radius of a sphere of the same volume.
    """

    site: np.ndarray
    geom: np.ndarray
    below_m: Array
    pad_of_geom: np.ndarray
    steel: np.ndarray
    steel_m3: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, pads: Sequence[PadConfig]) -> Places:
        """ModelError where the model has no site and no geom of a pad's name."""
        site, geom, below_m = (np.full(len(pads), fill) for fill in (-1, -1, 0.0))
        pad_of_geom = np.full(model.ngeom, -1)
        for number, pad in enumerate(pads):
            site[number] = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, pad.name)
            geom[number] = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, pad.name)
            if site[number] >= 0:
                geom[number] = -1
                pad_of_geom[model.geom_bodyid == model.site_bodyid[site[number]]] = number
            elif geom[number] >= 0:
                pad_of_geom[geom[number]] = number
                top_m = pad.magnet.rest_mm[2] * 1e-3 + TOP_M
                below_m[number] = top_m - model.geom_size[geom[number], 2]
            else:
                raise ModelError(
                    f"pad '{pad.name}': the model has no site and no geom of this name: add "
                    f'<site name="{pad.name}"/> to the body of the pad, its z toward the finger'
                )
        of_material = [
            mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_MATERIAL, each) if each >= 0 else ""
            for each in model.geom_matid
        ]
        steel = np.array([number for number, name in enumerate(of_material) if name == STEEL], dtype=int)
        steel_m3 = np.array([volume_m3(model, each) for each in steel]) * 3.0 / (4.0 * np.pi)
        return cls(site, geom, below_m, pad_of_geom, steel, steel_m3)

    def poses(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Origin (K, 3) in m and rotation (K, 3, 3) of each pad's axes in the world."""
        is_site = self.site >= 0
        if is_site.all():
            return data.site_xpos[self.site], data.site_xmat[self.site].reshape(-1, 3, 3)
        place_m = np.where(is_site[:, None], data.site_xpos[self.site], data.geom_xpos[self.geom])
        turn = np.where(is_site[:, None], data.site_xmat[self.site], data.geom_xmat[self.geom]).reshape(-1, 3, 3)
        return place_m - self.below_m[:, None] * turn[:, :, 2], turn


def volume_m3(model: mujoco.MjModel, geom: int) -> float:
    """ModelError for a geom that has no volume of its own."""
    shape, (a, b, c) = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    match shape:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return float(4.0 / 3.0 * np.pi * a**3)
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return float(4.0 / 3.0 * np.pi * a * b * c)
        case mujoco.mjtGeom.mjGEOM_BOX:
            return float(8.0 * a * b * c)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return float(2.0 * np.pi * a**2 * b)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return float(2.0 * np.pi * a**2 * b + 4.0 / 3.0 * np.pi * a**3)
        case _:
            raise ModelError(f"geom {geom}: a {shape.name[7:].lower()} of steel is not known: use boxes or cylinders")
