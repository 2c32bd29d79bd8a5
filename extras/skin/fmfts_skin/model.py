"""Contact models of a pad whose magnets are unknown, from files: from contact to field, or from field to force."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmfts.common.reading import read_regular, unreadable_told
from fmfts.contact.contract import ModelError, OtherPadError
from fmfts.contact.seal import hash_of
from fmfts_skin.field_response import LARGEST_BYTES, FieldResponse, FieldResponseError
from fmfts_skin.force_model import LARGEST_BYTES as FORCE_BYTES
from fmfts_skin.force_model import ForceModel, ForceModelError

# Loads for which a message has a field, or which at least give a place.
TOLD_LOADS = ("force_n", "depth_mm")
MADE_FROM = {"field": "the field", "both": "the field and the magnet's pose"}


@dataclass(frozen=True, slots=True)
class SkinModel:
    """response: of the structure. hash: of the file's content, as messages and recordings name it."""

    response: FieldResponse
    hash: str

    @property
    def told(self) -> str:
        """The model's description in a few words for the log."""
        place = "place" if self.response.load else ""
        tells = " and ".join(filter(None, (place, "force" if self.response.axes[-1].name == "force_n" else "")))
        return f"unknown magnets, {tells}"

    @property
    def calibrated_range(self) -> dict[str, object]:
        """The places and forces that it was calibrated for."""
        facts: dict[str, object] = {}
        for axis in self.response.axes:
            if axis.name == "force_n":
                facts["calibrated_force_n"] = axis.last
            elif axis.name != "depth_mm":
                facts[f"calibrated_{axis.name[0]}_m"] = [axis.first * 1e-3, axis.last * 1e-3]
        return facts

    @property
    def told_names(self) -> tuple[str, ...]:
        """The names of the numbers of a contact."""
        return tuple(axis.name for axis in self.response.axes)

    @property
    def largest_load(self) -> float:
        return self.response.axes[-1].last

    @classmethod
    def load(cls, path: Path, sensors: int) -> SkinModel:
        """ModelError if the file cannot be used, OtherPadError if it is for another number of sensors."""
        with unreadable_told(ModelError, f"contact model {path}"):
            content = read_regular(path, LARGEST_BYTES)
        try:
            response = FieldResponse.of(content, str(path))
        except FieldResponseError as error:
            raise ModelError(
                f"contact model {error}; `fmfts-daemon calibrate` makes one for a pad whose magnets are unknown, and "
                "a pad with several known magnets has a [[pad.magnet]] table for each"
            ) from error
        table = len(response.reference_ut) // 3
        if table != sensors:
            raise OtherPadError(f"contact model {path}: is of {table} sensors, the pad has {sensors}: see sensors_mm")
        load, places = response.axes[-1].name, response.load
        if load not in TOLD_LOADS or (load == "depth_mm" and not places):
            raise ModelError(
                f"contact model {path}: is of {', '.join(axis.name for axis in response.axes)}: a running pad gives a "
                "place or a normal force, so it needs x_mm, y_mm and depth_mm, or force_n"
            )
        return cls(response, hash_of(content))


@dataclass(frozen=True, slots=True)
class SkinForceModel:
    """forces: polynomials from the change of the field. hash: as SkinModel's."""

    forces: ForceModel
    hash: str

    @property
    def told(self) -> str:
        """What it is, in a few words for the log."""
        return f"force in three directions, from {MADE_FROM[self.forces.route]}"

    @property
    def calibrated_range(self) -> dict[str, object]:
        """The forces that it was calibrated for."""
        return {"calibrated_force_n": self.largest_load}

    @property
    def told_names(self) -> tuple[str, ...]:
        """The names of the numbers of a contact; the last counts a press as positive."""
        return ("shear_x_n", "shear_y_n", "force_n")

    @property
    def largest_load(self) -> float:
        return self.forces.largest_n

    @property
    def needs_poses(self) -> bool:
        """Of the pad's one magnet."""
        return self.forces.route != "field"

    def values(self) -> NDArray[np.intp]:
        """(C,): which of a frame's (3N,) fields it reads."""
        fields = [name for name in self.forces.names if len(name) > 1]
        return np.array([3 * int(name[1:-1]) - 3 + "xyz".index(name[-1]) for name in fields])

    @classmethod
    def load(cls, path: Path, sensors: int) -> SkinForceModel:
        """ModelError if the file cannot be used, OtherPadError if it is for sensors that the pad does not have."""
        with unreadable_told(ModelError, f"contact model {path}"):
            content = read_regular(path, FORCE_BYTES)
        try:
            forces = ForceModel.of(content, str(path))
        except ForceModelError as error:
            raise ModelError(f"contact model {error}; `fmfts-daemon calibrate` makes one of forces") from error
        if forces.route == "pose":
            raise ModelError(
                f"contact model {path}: goes from poses alone to forces, which a running pad does not do: "
                "`calibrate … --route both`"
            )
        model = cls(forces, hash_of(content))
        if model.values().max() >= 3 * sensors:
            raise OtherPadError(f"contact model {path}: has more sensors than the pad's {sensors}: see sensors_mm")
        return model
