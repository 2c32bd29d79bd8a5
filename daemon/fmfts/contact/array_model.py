"""The contact model of a pad with several magnets: how presses move them, from a file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmfts.common.reading import read_regular, unreadable_told
from fmfts.contact.array_response import LARGEST_BYTES, ArrayResponse, ResponseError
from fmfts.contact.contract import ModelError, OtherPadError
from fmfts.contact.seal import hash_of
from fmfts.pad import Pad, RestingMagnet, SensorArray

ARRAY_PATH = Path(__file__).with_name("array.response")
# Places (8, 3) in mm of the second standard pad's sensors. A table of presses describes magnets and silicone only, but
# its hash is that of a whole pad with these sensors.
STANDARD_SENSORS_MM = np.array(
    [(12, 0, 0), (-12, 0, 0), (0, 12, 0), (0, -12, 0), (12, 12, 0), (12, -12, 0), (-12, 12, 0), (-12, -12, 0)], float
)
# The places of its magnets in mm, and the sign of each pole, in the order of the table.
STANDARD_MAGNETS = ((6, 6, 12, 1), (6, -6, 12, -1), (-6, 6, 12, -1), (-6, -6, 12, 1))


@dataclass(frozen=True, slots=True)
class ArrayModel:
    """response: of the pad's magnets. hash: of the file's content, as messages and recordings name it."""

    response: ArrayResponse
    hash: str

    @property
    def told(self) -> str:
        """A short description for the log."""
        return f"{self.response.magnets} magnets, up to two fingers"

    @property
    def calibrated_range(self) -> dict[str, object]:
        """The places and forces that it was calibrated for."""
        along_m = [self.response.first_mm * 1e-3, self.response.last_mm * 1e-3]
        return {"calibrated_x_m": along_m, "calibrated_y_m": along_m, "calibrated_force_n": self.response.scale_n}

    @classmethod
    def load(cls, path: Path, pad: Pad) -> ArrayModel:
        """ModelError if the file cannot be used, OtherPadError if it is for other magnets.

        A file made for the pad's magnets over the standard sensors is for this pad too, whatever its own sensors are.
        The second standard pad may name its magnets in any order.
        """
        with unreadable_told(ModelError, f"contact model {path}"):
            content = read_regular(path, LARGEST_BYTES)
        try:
            response = ArrayResponse.of(content, str(path))
        except ResponseError as error:
            raise ModelError(f"contact model {error}") from error
        if (order := standard_magnets_of(pad, response)) is not None and len(order) == response.magnets:
            return cls(response.only(order), hash_of(content))
        drawn = replace(pad, sensors=SensorArray.aligned(STANDARD_SENSORS_MM * 1e-3))
        if response.geometry_hash not in (pad.geometry_hash, drawn.geometry_hash):
            raise OtherPadError(
                f"contact model {path}: is for another pad: its dimensions have the hash {response.geometry_hash}, "
                f"those of pad '{pad.name}' {pad.geometry_hash}, over the standard sensors {drawn.geometry_hash}: "
                "compare [[pad.magnet]] with docs/several.md; other magnets need a table of their own"
            )
        if response.magnets != len(pad.magnets):
            raise ModelError(f"contact model {path}: is of {response.magnets} magnets, the pad has {len(pad.magnets)}")
        return cls(response, hash_of(content))


def standard_magnets_of(pad: Pad, response: ArrayResponse) -> list[int] | None:
    """Which of the second standard pad's magnets a pad holds, in its order; None if it holds others, or if `response`
    is not the standard pad's."""
    places = [(*(1e3 * one.rest_position_m).tolist(), *one.rest_axis.tolist()) for one in pad.magnets]
    standard = [(float(x), float(y), float(z), 0.0, 0.0, float(up)) for x, y, z, up in STANDARD_MAGNETS]
    kind = pad.magnets[0].magnet
    if not all(one in standard for one in places) or any(one.magnet != kind for one in pad.magnets):
        return None
    first, *others = (RestingMagnet(kind, np.array(one[:3]) * 1e-3, np.array(one[3:])) for one in standard)
    drawn = replace(
        pad,
        sensors=SensorArray.aligned(STANDARD_SENSORS_MM * 1e-3),
        rest_position_m=first.rest_position_m,
        rest_axis=first.rest_axis,
        other_magnets=tuple(others),
    )
    return [standard.index(one) for one in places] if drawn.geometry_hash == response.geometry_hash else None
