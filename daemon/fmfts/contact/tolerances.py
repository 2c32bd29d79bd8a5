"""The uncertainty of a contact from the pad's structure: stiffness and thickness of its silicone, and the finger.

tolerances.c includes it in every deviation. It is the same in each frame: a calibration reduces it, a filter does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import root_of_squares
from fmfts.common.record import Numbers

# One standard deviation of cast silicone. Sylgard 184, which build-a-pad.md names, has a Young's modulus of 1.32 MPa
# cured at 25 °C and of 2.97 MPa cured at 200 °C (Johnston et al., "Mechanical characterization of bulk Sylgard 184 for
# microfluidics and microengineering", J. Micromech. Microeng. 24, 035017, 2014); 20 MPa over the ratio of base to agent
# (Wang et al., J. Appl. Polym. Sci. 131, 41050, 2014). The shipped pads have 1.22 MPa. Within the cures of
# build-a-pad.md, and weighed by hand: ± 40 % as two deviations.
MODULUS = 0.2
THICKNESS_M = 0.2e-3  # poured by hand up to a mark, and levelled by eye
FINGER_M = (3e-3, 12e-3)
PROBE_M = 6e-3  # width of the probe that calibrated the shipped pads
SHAPE_SHARE = 1.0 / 3.0  # deviation of a width's correction: a square's second moment is so much larger

# Errors of an answer on a slab that is a millimetre thicker, by distance from the middle: the place outwards, in mm,
# and the logarithm of the share by which the force is too small. Small strains, mean of an axis and a diagonal:
# `python -m fmfts_lab.finite_elements.thickness`.
RING_MM = 2.0
THICKER_MM = np.array([0.0, -0.25, -0.53, -0.51, 0.08, 1.01, 1.80, 2.10])
THICKER_SHARE = np.array([-0.58, -0.60, -0.63, -0.64, -0.57, -0.40, -0.16, 0.09])


@dataclass(frozen=True, slots=True)
class StructureTolerance:
    """modulus: standard deviation of its logarithm. thickness_m: of the slab. finger_m: the smallest and the largest
    width of what presses. The first value of each: it is as calibrated.

    is_weighed: a weight measured the scale of forces in the middle; `modulus` is the remaining deviation.
    probe_m: width of the probe that made the model, so that a known finger corrects it; None: not known, and the user's
    own presses may contain that finger already.
    """

    modulus: float = 0.0
    thickness_m: float = 0.0
    finger_m: tuple[float, float] = (PROBE_M, PROBE_M)
    is_weighed: bool = False
    probe_m: float | None = PROBE_M

    @property
    def for_c(self) -> dict[str, Numbers]:
        """The fields that tolerances.c needs: contact/step.h."""
        thicker_mm = self.thickness_m * 1e3
        return {
            "modulus": self.modulus,
            "finger_mm2": self.finger_mm2,
            "known_finger_mm2": self.known_finger_mm2,
            "ring_mm": RING_MM,
            "thicker_mm": thicker_mm * THICKER_MM,
            "thicker_share": thicker_mm * (THICKER_SHARE - self._weighed_share),
        }

    @property
    def known_finger_mm2(self) -> float:
        """The excess of the second moment over the probe's, of the width nearest to the probe's; 0 where the widths
        include the probe's, or the model's probe is not known. Every finger has at least this."""
        if self.probe_m is None:
            return 0.0
        smallest_mm2, largest_mm2 = (wider_than_probe_mm2(width_m, self.probe_m) for width_m in self.finger_m)
        return max(smallest_mm2, 0.0) + min(largest_mm2, 0.0)

    @property
    def finger_mm2(self) -> float:
        """One deviation of a second moment: half the largest difference of a disc (w²/16) from the known one, and the
        unknown shape of a known width."""
        probe_m = PROBE_M if self.probe_m is None else self.probe_m
        farthest_mm2 = max(
            abs(wider_than_probe_mm2(width_m, probe_m) - self.known_finger_mm2) for width_m in self.finger_m
        )
        return float(root_of_squares(farthest_mm2 / 2.0, SHAPE_SHARE * self.known_finger_mm2))

    @property
    def force_share(self) -> float:
        """The deviation upwards of a force near the middle through the silicone, as a share: as in tolerances.c."""
        return float(exp(self.scale_deviation) - 1.0)

    @property
    def scale_deviation(self) -> float:
        """The deviation of the logarithm of the scale of forces."""
        thicker = self.thickness_m * 1e3 * (THICKER_SHARE[0] - self._weighed_share)
        return float(root_of_squares(self.modulus, thicker))

    @property
    def _weighed_share(self) -> float:
        """An error of thickness has also changed the result of the weight."""
        return float(THICKER_SHARE[0]) if self.is_weighed else 0.0

    def weighed(self, deviation: float) -> StructureTolerance:
        """The tolerance after a weight in the middle measured the scale of forces to this share."""
        return replace(self, modulus=deviation, is_weighed=True)


def wider_than_probe_mm2(width_m: float, probe_m: float = PROBE_M) -> float:
    """The second moment of a disc, minus the probe's."""
    return float(1e6 * (square(width_m) - square(probe_m)) / 16.0)
