"""A pad's stiffness by a known weight (pipeline/weighing.py), as part of its baseline's file."""

from __future__ import annotations

import msgspec

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline.file_format import now
from fmfts.common import possible
from fmfts.contact.tolerances import MODULUS, THICKNESS_M, StructureTolerance

# Another pad of its cast: the modulus of one batch and cure to 5 %, and a thickness of its own. The weight measured the
# old pad's thickness along with the modulus, so both pads' thicknesses count.
SAME_CURE = 0.05
OTHER_THICKNESS = StructureTolerance(thickness_m=THICKNESS_M).scale_deviation
UNWEIGHED = StructureTolerance(MODULUS, THICKNESS_M).scale_deviation


class StoredSilicone(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """stiffness: over that of the pad of the contact model with the hash `model`; deviation: of it, as a share.

    weight_n: that stood on the pad, at the time `utc`. weighed_deviation: on that pad; None: it is this one.
    """

    utc: str
    model: str
    weight_n: float
    stiffness: float
    deviation: float
    weighed_deviation: float | None = None

    def __post_init__(self) -> None:
        possible.FORCE_N.require([self.weight_n])
        possible.STIFFNESS.require([self.stiffness])
        possible.SHARE.require([self.deviation, self.own_deviation])

    @classmethod
    def of(cls, model: str, weight_n: float, stiffness: float, deviation: float) -> StoredSilicone:
        return cls(now(), model, weight_n, stiffness, deviation)

    @property
    def own_deviation(self) -> float:
        """`deviation` on the pad that was weighed."""
        return self.deviation if self.weighed_deviation is None else self.weighed_deviation

    def of_another_pad(self, unweighed: float = UNWEIGHED) -> StoredSilicone:
        """For a pad cast like the one that was weighed, however many there were since. It is not known worse than to
        `unweighed`, the deviation of the logarithm for a pad of any cast."""
        own = self.own_deviation
        cast_alike = float(root_of_squares(own, SAME_CURE, OTHER_THICKNESS, OTHER_THICKNESS))
        return msgspec.structs.replace(self, deviation=max(own, min(cast_alike, unweighed)), weighed_deviation=own)

    @property
    def known_to(self) -> str:
        """The deviation of forces, as `status` shows it, and on the pad that was weighed."""
        now, own = (StructureTolerance().weighed(one).force_share for one in (self.deviation, self.own_deviation))
        return f"± {now:.0%} (± {own:.0%} on the pad that was weighed)"
