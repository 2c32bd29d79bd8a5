"""The contact model of a pad whose magnets are unknown: a table from contact to field, from a file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from fmfts.common.reading import read_regular
from fmfts.contact.contract import ModelError, OtherPadError
from fmfts.contact.field_response import LARGEST_BYTES, FieldResponse, FieldResponseError

# Loads of which a message has a field, or that at least tell a place.
TOLD_LOADS = ("force_n", "depth_mm")


@dataclass(frozen=True, slots=True)
class SkinModel:
    """response: of the structure. hash: of the file's content, as messages and recordings name it."""

    response: FieldResponse
    hash: str

    @property
    def tells(self) -> str:
        """In words: what a contact has."""
        place = "place" if self.response.load else ""
        return " and ".join(filter(None, (place, "force" if self.response.axes[-1].name == "force_n" else "")))

    @classmethod
    def load(cls, path: Path, sensors: int) -> SkinModel:
        """ModelError if the file cannot be used, OtherPadError if it is for another number of sensors."""
        try:
            content = read_regular(path, LARGEST_BYTES)
            response = FieldResponse.of(content, str(path))
        except OSError as error:
            raise ModelError(f"contact model {path}: cannot be read: {error.strerror}") from error
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
                f"contact model {path}: is of {', '.join(axis.name for axis in response.axes)}: a running pad tells a "
                "place or a normal force, so it needs x_mm, y_mm and depth_mm, or force_n"
            )
        return cls(response, hashlib.sha256(content).hexdigest()[:12])
