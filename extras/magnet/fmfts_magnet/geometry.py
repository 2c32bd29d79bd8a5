"""The [pad.geometry] of the board that the check found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts_magnet.cost import MIRRORED_Z
from fmfts_magnet.readings import Array
from fmfts_magnet.verdict import Verdict


class NotWritableError(Exception):
    """The configuration cannot express the board, or nothing needs to be written; the text says why."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """place_m, rotation_deg (N, 3): of each channel, the second as a rotation vector."""

    place_m: Array
    rotation_deg: Array
    is_mirrored: bool

    def keys(self) -> dict[str, str]:
        """The keys of [pad.geometry] with their values as TOML."""
        return {
            "sensors_mm": _listed(self.place_m * 1e3),
            "sensor_rotations_deg": _listed(self.rotation_deg) if self.rotation_deg.any() else "[]",
            "sensors_mirrored": "true" if self.is_mirrored else "false",
        }


def keys_of(verdict: Verdict) -> dict[str, str]:
    """The keys of [pad.geometry] that must change, with their values as TOML. Raises NotWritableError."""
    if verdict.is_decided and verdict.layouts:
        return {"board": f'"{verdict.layouts[0]}"'}
    return geometry_of(verdict).keys()


def geometry_of(verdict: Verdict) -> Geometry:
    """The geometry of the explanation. Raises NotWritableError."""
    from scipy.spatial.transform import Rotation

    if not verdict.found or not verdict.is_decided:
        raise NotWritableError("the check did not decide what is wrong")
    one = verdict.found[0].explanation
    place = one.place[0]
    axes = verdict.board.axes[place] @ one.turn[0].transpose(0, 2, 1)
    mirrored = np.linalg.det(axes) < 0.0
    used = one.used[0]
    if mirrored[used].any() and not mirrored[used].all():
        odd = np.flatnonzero(used & (mirrored if mirrored[used].sum() * 2 <= used.sum() else ~mirrored))
        raise NotWritableError(
            f"the chips of one pad are all mirrored or none is, and sensor {odd[0] + 1} is not as the others: exchange "
            "that chip, or report it"
        )
    is_mirrored = bool(mirrored[used].any())
    rotations = axes @ MIRRORED_Z if is_mirrored else axes.copy()
    rotations[~used] = np.eye(3)
    found = Geometry(
        verdict.board.place_m[place], _rounded(Rotation.from_matrix(rotations).as_rotvec(degrees=True)), is_mirrored
    )
    if (place == np.arange(len(place))).all() and (one.turn[0] == np.eye(3)).all():
        raise NotWritableError("places, turns and mirrors of the chips are as configured")
    return found


def _rounded(values: Array) -> Array:
    rounded: Array = np.round(values, 4) + 0.0
    return rounded


def _listed(rows: Array) -> str:
    return "[" + ", ".join("[" + ", ".join(f"{value:g}" for value in _rounded(row)) + "]" for row in rows) + "]"
