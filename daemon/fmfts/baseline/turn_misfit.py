"""The misfit of a turn: its size against the expected one, and whether a touch, steel or one chip caused it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import complement, product
from fmfts.baseline.recording import BaselineError
from fmfts.common.chi2 import quantile

Array = NDArray[np.float64]

# Probability that an orientation of an untouched pad counts as touched; larger misfits than this, in expected
# deviations, are not caused by a touch.
FALSE_TOUCH = 1e-6
LARGEST_MISFIT = 5.0


@dataclass(frozen=True, slots=True)
class TurnMisfit:
    """misfit_t (K, N, 3) at K orientations, with the deviation_t (N, 3) that is expected, and their times (K,).

    by_field (N, 3, 3): what the chips report of unit ambient fields.
    """

    misfit_t: Array
    deviation_t: Array
    by_field: Array
    time_s: Array

    @property
    def inflation(self) -> float:
        """How much larger than expected the misfits are, at least 1."""
        return _compared(self._chi2, self._freedom)[0]

    @property
    def _chi2(self) -> Array:
        chi2: Array = square(self.misfit_t / self.deviation_t).sum(axis=(1, 2))
        return chi2

    @property
    def _freedom(self) -> int:
        return int(self.misfit_t[0].size) - 3

    def require_untouched(self) -> None:
        """BaselineError if a touch, steel or a chip caused the misfits."""
        chi2 = self._chi2
        inflation, touched = _compared(chi2, self._freedom)
        if inflation <= LARGEST_MISFIT and not touched.any():
            return
        worst = int(np.argmax(chi2))
        when = f"{self.time_s[worst]:.1f} s after the start"
        counted = f"({touched.sum()} of {len(chi2)} orientations)"
        alone = _sensor_alone(self.misfit_t / self.deviation_t, self.by_field / self.deviation_t[..., None])
        if alone is not None:
            raise BaselineError(
                f"sensor {alone + 1} alone does not see the field turn that the others see: it is off by "
                f"{np.abs(self.misfit_t[worst, alone]).max() * 1e7:.0f} mG {when} {counted}: its chip's offset jumped, "
                "as after a strong field, bits of its readings flip, or steel passed close to it: turn again, and if "
                "it stays, run selftest and look at its wires"
            )
        if inflation > LARGEST_MISFIT:
            raise BaselineError(
                "the sensors do not see one field turn: they disagree by "
                f"{np.sqrt(np.mean(square(self.misfit_t))) * 1e7:.1f} mG, where "
                f"{np.sqrt(np.mean(square(self.deviation_t))) * 1e7:.1f} mG is noise, most {when}: leave the pad "
                "untouched, keep steel away, and turn again"
            )
        raise BaselineError(
            f"the pad was touched, or passed steel, {when}: the sensors disagree by "
            f"{np.abs(self.misfit_t[worst]).max() * 1e7:.0f} mG there {counted}: leave it untouched: turn again, and "
            "hold the robot, not the pad"
        )


def _compared(chi2: Array, freedom: int) -> tuple[float, NDArray[np.bool_]]:
    """The ratio of the misfits (K,) to the expected ones, at least 1, and the outliers (K,) that remain after it."""
    inflation = max(1.0, float(np.sqrt(np.median(chi2) / freedom)))
    return inflation, np.asarray(chi2 > quantile(FALSE_TOUCH / len(chi2), freedom) * square(inflation), dtype=np.bool_)


def _sensor_alone(misfit: Array, by_field: Array) -> int | None:
    """The only sensor (from 0) without which the others see one field turn; None if there is none, or more than one.

    A touch moves the magnet, which is equally far from all sensors: all of them measure it. A fault of one chip, or its
    wires, is in that chip's readings alone. misfit (K, N, 3), by_field (N, 3, 3): in deviations.
    """
    count = misfit.shape[1]
    found = []
    for sensor in range(count) if count > 2 else ():
        others = np.arange(count) != sensor
        # The part that no ambient field explains, so that it does not depend on the field estimated with the bad
        # sensor.
        parity = complement(by_field[others].reshape(-1, 3)).T
        chi2 = square(product(misfit[:, others].reshape(len(misfit), -1), parity.T)).sum(axis=1)
        inflation, touched = _compared(chi2, len(parity))
        if inflation <= LARGEST_MISFIT and not touched.any():
            found.append(sensor)
    return found[0] if len(found) == 1 else None
