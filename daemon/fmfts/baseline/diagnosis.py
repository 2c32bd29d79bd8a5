"""Refuses a baseline that does not fit a mounted, unloaded pad, and names the likely cause."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.matrix import lengths
from fmfts.baseline.mounting import Mounting, estimate_mounting
from fmfts.baseline.recording import BaselineError, Recording
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.suspicions import Assumption, Fault, faults_alone, faults_in_company, no_magnet
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad, Tolerance
from fmfts.pose.magnets import Magnets, sum_of_fields

Array = NDArray[np.float64]

# The probability of refusing a pad that is within its tolerances.
FALSE_REFUSAL = 1e-5
# A rest pose further than this from the drawing (`rest_strain`) counts as a load, or a magnet cast elsewhere. Three in
# a million pads within their tolerances are so far off; with chips turned by a third more than that, one in a thousand.
LARGEST_STRAIN = 5.0
# The Earth's field plus that of a robot's own steel; more means a magnet or iron close by.
LARGEST_AMBIENT_T = 2e-4
# Steel about a pad weakens the Earth's field, but not to a fifth of where it is weakest.
SMALLEST_AMBIENT_T = 5e-6
# A chip's typical zero counts as one deviation of each axis. Together with the Earth's field, the zeros of fewer than
# one chip in a thousand exceed LARGEST_AMBIENT_T by more than this.
LARGEST_ZERO = 3.0
# From this share of the drawn magnet's field on, a magnet is present. The LIS3MDL's zeros cause an error of 0.24
# (standard pad): one bare pad in 400 is refused. One mounted pad in seven is not refused; `--rest` then finds no
# magnet.
MAGNET_SHARE = 0.75
# Two causes are alike unless one is ten times as probable as the other: in units of −2 ln of the evidence.
ALIKE = 2.0 * 2.303
MOST_TOLD = 3
NO_MAGNET = "There is no magnet above the sensors: mount the pad, then record --rest."
SLIGHT_MISFIT_T = 1e-6  # five deviations of a sample; a smaller misfit of an axis is no cause of a refusal
WITHOUT_BARE = (
    "Or a chip's own zero is off, which only `baseline --bare` measures: take the pad off, record --bare, mount it, "
    "and record --rest again."
)
# The likeliest single faults, and how many others each is combined with first; all others follow if none of these fits.
FIRST_FAULTS, LIKELY_SECONDS = 5, 24
# A second fault has a probability of one in twenty: −2 ln.
SECOND_FAULT = 6.0


class MisfitError(BaselineError):
    """The recordings fit no unloaded pad. facts: how badly, without the cause that the text names."""

    def __init__(self, facts: str, cause: str) -> None:
        super().__init__(f"{facts} {cause}")
        self.facts = facts


def check_bare(pad: Pad, bare: Recording) -> None:
    """BaselineError if the field without the pad is too strong for the robot's surroundings and the chips' zeros."""
    zero_t = pad.chip.zero_t or 0.0
    limit_t = LARGEST_AMBIENT_T + LARGEST_ZERO * zero_t
    size = lengths(bare.mean_t)
    if size.max() > limit_t:
        sensor = int(np.argmax(size))
        own = f", and the zero of {pad.chip.named} is typically off by {zero_t * 1e6:.0f} µT an axis" if zero_t else ""
        raise BaselineError(
            f"sensor {sensor + 1} sees {size[sensor] * 1e6:.0f} µT without the pad; at most {limit_t * 1e6:.0f} µT are "
            f"plausible (the Earth's field has 25–65 µT{own}): "
            "is the magnet still mounted, or steel or another magnet nearby?"
        )
    # Where zeros may be as large as the magnet's field, only its pattern over the sensors tells them apart.
    if zero_t and pad.are_magnets_known and abs(share := _magnet_share(pad, bare)) > MAGNET_SHARE:
        raise BaselineError(
            f"the sensors see {share:+.0%} of the drawn magnet's field without the pad: is it still mounted? If not, "
            "move the sensors away from other magnets, and record --bare again. Where that does not help, the chips' "
            "own zeros happen to look like the magnet: exchange two of them."
        )


def weak_field(bare: Recording) -> list[str]:
    """A warning if no sensor sees the Earth's field. A shield or a simulation may have none, so it is no error."""
    largest_t = float(lengths(bare.mean_t).max())
    if largest_t >= SMALLEST_AMBIENT_T:
        return []
    seen = f"at most {largest_t * 1e6:.2f} µT" if largest_t else "exactly 0"
    return [
        f"each sensor sees {seen} without the pad, and the Earth's field has 25–65 µT. In a magnetic shield, or a "
        "simulation without an ambient field, this is right. Otherwise the chips do not measure, or are not of the "
        "configured kind (`fmfts-daemon probe` says which), or the source does not give teslas."
    ]


def _magnet_share(pad: Pad, bare: Recording) -> float:
    """The share of the drawn magnets' field at rest in the differences between the sensors, by least squares."""
    drawn = sum_of_fields(Magnets.drawn(pad), pad.sensors.position_m)
    pattern = drawn - drawn.mean(axis=0)
    return float((pattern * pad.sensors.to_pad(bare.mean_t)).sum() / square(pattern).sum())


def estimate_and_judge(
    pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None, measured: Sensitivity | None = None
) -> Mounting:
    """The estimated mounting if it is plausible, else MisfitError with the misfit and its likely cause."""
    mounting = estimate_mounting(pad, tolerance, rest, bare, measured=measured)
    if _fits(mounting) and np.abs(mounting.rest_strain).max() < LARGEST_STRAIN:
        return mounting
    if absent := no_magnet(pad, tolerance, rest, bare):
        raise MisfitError(absent, NO_MAGNET)
    # Assume that the sensors are known exactly: then the misfit shows at the one that causes it, not at all of them.
    known = measured or Sensitivity.untested(len(pad.sensors), tolerance)
    exact = replace(known, covariance=np.zeros(known.covariance.shape))
    misfit = estimate_mounting(pad, replace(tolerance, sensor_position_m=0.0), rest, bare, measured=exact).misfit_t
    worst = np.unravel_index(int(np.argmax(np.abs(misfit))), misfit.shape)
    facts = (
        f"the field does not fit an unloaded pad: χ² = {mounting.chi2:.0f}, where tolerances, gains and noise explain "
        f"at most {_limit(mounting):.0f}; magnet {np.abs(mounting.rest_strain).max():.1f} deviations from its place"
    )
    if abs(misfit[worst]) > SLIGHT_MISFIT_T:  # below it, the magnet's place or strength does not fit
        facts += f"; worst: sensor {worst[0] + 1}, axis {'xyz'[worst[1]]}, {misfit[worst] * 1e6:+.1f} µT off"
    facts += "."
    cause = _cause(pad, tolerance, rest, bare, measured)
    raise MisfitError(facts, cause if bare is not None else f"{cause} {WITHOUT_BARE}")


def _limit(mounting: Mounting) -> float:
    return quantile(FALSE_REFUSAL, mounting.measurements)


def _fits(mounting: Mounting) -> bool:
    return mounting.chi2 < _limit(mounting)


def _cause(
    pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None, measured: Sensitivity | None
) -> str:
    """The likely cause in a sentence, or both where two are alike."""
    as_drawn = Assumption.of(pad, tolerance)

    def tried(*faults: Fault) -> _Explanation:
        assumption = reduce(lambda before, fault: fault(before), faults, as_drawn)
        mounting = assumption.mounting(rest, bare, measured)
        surprise = mounting.surprise + 2.0 * log(assumption.alternatives) + SECOND_FAULT * (len(faults) - 1)
        return _Explanation(faults, surprise, assumption, mounting)

    together = [tried(fault) for fault in faults_in_company(pad, tolerance)]
    together.sort(key=lambda one: one.surprise)
    found = [one for one in (*(tried(fault) for fault in faults_alone(pad)), *together) if _fits(one.mounting)]
    for seconds in (together[:LIKELY_SECONDS], together):
        pairs = [
            tried(*first.faults, *second.faults)
            for number, first in enumerate(together[:FIRST_FAULTS])
            for second in seconds[number + 1 :]
        ]
        found += [one for one in pairs if _fits(one.mounting)]
        if found:
            break
    if not found:
        return "Nothing that is known explains it: steel or a magnet nearby, or another pad than that of the config."
    least = min(one.surprise for one in found)
    alike = sorted((one for one in found if one.surprise < least + ALIKE), key=lambda one: one.surprise)
    enough = {fault for one in alike if len(one.faults) == 1 for fault in one.faults}
    told = [one.told for one in alike if len(one.faults) == 1 or not enough & set(one.faults)]
    return " Or: ".join(list(dict.fromkeys(told))[:MOST_TOLD])


@dataclass(frozen=True, slots=True)
class _Explanation:
    """Assumed faults, −2 ln of their probability after the recordings, and the mounting with them."""

    faults: tuple[Fault, ...]
    surprise: float
    assumption: Assumption
    mounting: Mounting

    @property
    def told(self) -> str:
        return self.assumption.told(self.mounting)
