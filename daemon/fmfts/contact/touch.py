"""Is the pad touched? A χ² test of the magnet's displacement from rest, with hysteresis."""

from __future__ import annotations

from math import isfinite

from fmfts.arithmetic.matrix import SingularError, cholesky, product, solve_lower
from fmfts.common.chi2 import quantile
from fmfts.common.double_table import Named
from fmfts.pad import Array

DEGREES_OF_FREEDOM = 5  # position, and the axis's two tangents
# A contact ends when several frames in a row are as close to rest as 99 % of unloaded ones are.
RELEASE_PROBABILITY = 0.01
RELEASE_FRAMES = 5


class TouchDetector:
    """Contact or none, frame by frame.

    A contact begins with one frame whose χ² an unloaded pad exceeds `false_contacts_per_hour` times in an hour at
    `rate_hz`, frames being independent and the covariance honest.
    """

    def __init__(self, rate_hz: float, false_contacts_per_hour: float = 1.0) -> None:
        per_frame = false_contacts_per_hour / (3600.0 * rate_hz)
        self.onset_chi2 = quantile(min(per_frame, RELEASE_PROBABILITY), DEGREES_OF_FREEDOM)
        self.release_chi2 = quantile(RELEASE_PROBABILITY, DEGREES_OF_FREEDOM)
        # After a longer one, who touched before it may be gone: half a period is for jitter.
        self.longest_gap_s = (RELEASE_FRAMES + 0.5) / rate_hz
        self._touched = False
        self._quiet_frames = 0

    def write(self, memory: Named) -> None:
        """For the compiled path."""
        memory.put("touched", self._touched)
        memory.put("quiet_frames", self._quiet_frames)

    def read(self, memory: Named) -> None:
        """What `write` wrote, and the compiled path went on with."""
        self._touched, self._quiet_frames = bool(memory.number("touched")), int(memory.number("quiet_frames"))

    def update(self, displacement: Array | None, covariance: Array | None) -> bool | None:
        """Contact after this frame; None where it has no usable pose. The state before a gap holds after it.

        displacement: (5,) from rest, position in m and tangent of the axis in rad; covariance: (5, 5) of it, rest's
        own included.
        """
        chi2 = _chi2(displacement, covariance)
        if chi2 is None:
            return None
        self._quiet_frames = self._quiet_frames + 1 if chi2 < self.release_chi2 else 0
        if chi2 > self.onset_chi2:
            self._touched = True
        elif self._quiet_frames >= RELEASE_FRAMES:
            self._touched = False
        return self._touched

    def unseen(self) -> None:
        """A frame that told no pose. Who touched may be gone since: after as many as end a contact, an onset is asked.

        Else each gap would be followed by a false contact as often as RELEASE_PROBABILITY says.
        """
        self._quiet_frames = min(self._quiet_frames + 1, RELEASE_FRAMES)
        if self._quiet_frames == RELEASE_FRAMES:
            self._touched = False

    def forget(self) -> None:
        """As if nothing had touched yet."""
        self._touched, self._quiet_frames = False, 0


def _chi2(displacement: Array | None, covariance: Array | None) -> float | None:
    """dᵀΣ⁻¹d, None unless Σ is a covariance and all is finite."""
    if displacement is None or covariance is None:
        return None
    try:
        whitened = solve_lower(cholesky(covariance), displacement)
    except SingularError:
        return None
    chi2: float = product(whitened, whitened)
    return chi2 if isfinite(chi2) else None
