"""A pad's stiffness by a known weight (pipeline/weighing.py), as part of its baseline's file."""

from __future__ import annotations

import msgspec

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline.file_format import now
from fmfts.common import possible
from fmfts.contact.tolerances import THICKNESS_M, StructureTolerance

# Another pad of its cast: the modulus of one batch and cure to 5 %, and a thickness of its own. The weight measured the
# old pad's thickness along with the modulus, so both pads' thicknesses count.
SAME_CURE = 0.05
OTHER_THICKNESS = StructureTolerance(thickness_m=THICKNESS_M).force_share


class StoredSilicone(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """stiffness: over that of the pad of the contact model with the hash `model`; deviation: of it, as a share.

    weight_n: that stood on the pad, at the time `utc`.
    """

    utc: str
    model: str
    weight_n: float
    stiffness: float
    deviation: float

    def __post_init__(self) -> None:
        possible.FORCE_N.require([self.weight_n])
        possible.STIFFNESS.require([self.stiffness])
        possible.SHARE.require([self.deviation])

    @classmethod
    def of(cls, model: str, weight_n: float, stiffness: float, deviation: float) -> StoredSilicone:
        return cls(now(), model, weight_n, stiffness, deviation)

    def of_another_pad(self) -> StoredSilicone:
        """For a pad cast like this one."""
        deviation = root_of_squares(self.deviation, SAME_CURE, OTHER_THICKNESS, OTHER_THICKNESS)
        return msgspec.structs.replace(self, deviation=float(deviation))
