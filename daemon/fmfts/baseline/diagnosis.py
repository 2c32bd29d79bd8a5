"""Refuses a baseline that does not fit a mounted, unloaded pad, and names the likely cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import lengths
from fmfts.baseline.mounting import Mounting, estimate_mounting
from fmfts.baseline.recording import BaselineError, Recording
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.suspicions import Assumption, combined_changes, no_magnet, single_changes
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad, Tolerance

Array = NDArray[np.float64]

# The probability of refusing a pad that is within its tolerances.
FALSE_REFUSAL = 1e-5
# A rest pose further than this from the drawing, in tolerances, counts as a load; of good pads, one in 3000 is so far.
LARGEST_STRAIN = 4.0
# The Earth's field plus that of a robot's own steel; more means a magnet or iron close by.
LARGEST_AMBIENT_T = 2e-4
# Two causes are alike if one is not ten times as probable as the other: in units of −2 ln of the evidence.
ALIKE = 2.0 * 2.303
MOST_TOLD = 3
# Where no single fault explains a field, so many of the likeliest are combined with each other one.
MOST_COMBINED = 5


def check_bare(pad: Pad, bare: Recording) -> None:
    """BaselineError if the field without the pad is too strong for the robot's surroundings."""
    size = lengths(bare.mean_t)
    if size.max() > LARGEST_AMBIENT_T:
        sensor = int(np.argmax(size))
        raise BaselineError(
            f"sensor {sensor + 1} sees {size[sensor] * 1e6:.0f} µT without the pad (the Earth's field has 25–65 µT): "
            "is the magnet still mounted, or steel or another magnet nearby?"
        )


def estimate_and_judge(
    pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None, measured: Sensitivity | None = None
) -> Mounting:
    """The estimated mounting if it is plausible, else BaselineError with the misfit and its likely cause."""
    mounting = estimate_mounting(pad, tolerance, rest, bare, measured=measured)
    if _fits(mounting) and np.abs(mounting.rest_strain).max() < LARGEST_STRAIN:
        return mounting
    # Assume perfect sensors here: then the misfit shows at the sensor that causes it, and not at all of them.
    misfit = estimate_mounting(
        pad,
        replace(tolerance, sensor_position_m=0.0, gain=0.0, sensor_rotation_rad=0.0, cross_axis=0.0),
        rest,
        bare,
        measured=measured,
    ).misfit_t
    worst = np.unravel_index(int(np.argmax(np.abs(misfit))), misfit.shape)
    facts = (
        f"the field does not fit an unloaded pad: χ² = {mounting.chi2:.0f}, where tolerances, gains and noise explain "
        f"at most {_limit(mounting):.0f}; magnet {np.abs(mounting.rest_strain).max():.1f} tolerances from its place; "
        f"worst: sensor {worst[0] + 1}, axis {'xyz'[worst[1]]}, {misfit[worst] * 1e6:+.1f} µT off."
    )
    raise BaselineError(f"{facts} {_cause(pad, tolerance, rest, bare, measured)}")


def _limit(mounting: Mounting) -> float:
    return quantile(FALSE_REFUSAL, mounting.measurements)


def _fits(mounting: Mounting) -> bool:
    return mounting.chi2 < _limit(mounting)


def _cause(
    pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None, measured: Sensitivity | None
) -> str:
    """The likely cause in a sentence, or both where two are alike."""
    if no_magnet(pad, tolerance, rest, bare):
        return "There is no magnet above the sensors: mount the pad, then record --rest."
    as_drawn = Assumption.of(pad, tolerance)

    def tried(assumption: Assumption) -> tuple[float, Assumption, Mounting]:
        mounting = assumption.mounting(rest, bare, measured)
        return mounting.surprise, assumption, mounting

    singles = [tried(change(as_drawn)) for change in single_changes(pad, tolerance)]
    found = [one for one in singles if _fits(one[2])]
    if not found:
        together = list(combined_changes(pad))
        likeliest = sorted((tried(change(as_drawn)) for change in together), key=lambda one: one[0])[:MOST_COMBINED]
        pairs = (second(first) for _, first, _ in likeliest for second in together)
        found = [one for one in map(tried, pairs) if _fits(one[2])]
    if not found:
        return (
            "No single fault explains it, nor do two: steel or a magnet nearby, or sensors_mm, rest_mm and remanence_t "
            "in the config are not this pad's."
        )
    least = min(surprise for surprise, _, _ in found)
    alike = sorted((one for one in found if one[0] < least + ALIKE), key=lambda one: one[0])
    told = list(dict.fromkeys(assumption.told(mounting) for _, assumption, mounting in alike))
    return " Or: ".join(told[:MOST_TOLD])
