"""Refuses a baseline that does not fit a mounted, unloaded pad, and names the likely cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import lengths, product
from fmfts.baseline.gains import Gains
from fmfts.baseline.mounting import Mounting, estimate_mounting
from fmfts.baseline.recording import BaselineError, Recording
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad, Tolerance

Array = NDArray[np.float64]

# The probability of refusing a pad that is within its tolerances.
FALSE_REFUSAL = 1e-5
# A rest pose further than this from the drawing, in tolerances, counts as a load; of good pads, one in 3000 is so far.
LARGEST_STRAIN = 4.0
# The Earth's field plus that of a robot's own steel; more means a magnet or iron close by.
LARGEST_AMBIENT_T = 2e-4
# Tolerances far beyond those of mounting, as a finger or a wrong rest_mm needs them.
LOADED = {"magnet_position_m": 3e-3, "magnet_tilt_rad": 0.35}


@dataclass(frozen=True, slots=True)
class _Suspicion:
    mounting: Mounting
    sentence: str

    @property
    def plausible(self) -> bool:
        return _fits(self.mounting)


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
    pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None, gains: Gains | None = None
) -> Mounting:
    """The estimated mounting if it is plausible, else BaselineError with the misfit and its likely cause."""
    mounting = estimate_mounting(pad, tolerance, rest, bare, gains=gains)
    if _fits(mounting) and np.abs(mounting.rest_strain).max() < LARGEST_STRAIN:
        return mounting
    # Assume perfect sensors here: then the misfit shows at the sensor that causes it, and not at all of them.
    misfit = estimate_mounting(
        pad, replace(tolerance, sensor_position_m=0.0, gain=0.0), rest, bare, gains=gains
    ).misfit_t
    worst = np.unravel_index(int(np.argmax(np.abs(misfit))), misfit.shape)
    facts = (
        f"the field does not fit an unloaded pad: χ² = {mounting.chi2:.0f}, where tolerances, gains and noise explain "
        f"at most {_limit(mounting):.0f}; magnet {np.abs(mounting.rest_strain).max():.1f} tolerances from its place; "
        f"worst: sensor {worst[0] + 1}, axis {'xyz'[worst[1]]}, {misfit[worst] * 1e6:+.1f} µT off."
    )
    plausible = [suspicion for suspicion in _suspicions(pad, tolerance, rest, bare, gains) if suspicion.plausible]
    if not plausible:
        cause = (
            "No single fault explains it: steel or a magnet nearby, or sensors_mm, rest_mm and remanence_t in the "
            "config are not this pad's."
        )
    else:
        likeliest = min(plausible, key=lambda suspicion: suspicion.mounting.chi2 / suspicion.mounting.measurements)
        cause = likeliest.sentence
    raise BaselineError(f"{facts} {cause}")


def _limit(mounting: Mounting) -> float:
    return quantile(FALSE_REFUSAL, mounting.measurements)


def _fits(mounting: Mounting) -> bool:
    return mounting.chi2 < _limit(mounting)


def _suspicions(
    pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None, gains: Gains | None
) -> Iterator[_Suspicion]:
    """The single faults to try, each with the mounting that is estimated under the assumption of this fault."""
    count = len(pad.sensors)
    yield _Suspicion(
        estimate_mounting(replace(pad, rest_axis=-pad.rest_axis), tolerance, rest, bare, gains=gains),
        "The magnet is in upside down: turn it, or negate rest_axis.",
    )
    for one, other in combinations(range(count), 2):
        order = np.arange(count)
        order[[one, other]] = other, one
        yield _Suspicion(
            estimate_mounting(pad, tolerance, _reordered(rest, order), bare and _reordered(bare, order), gains=gains),
            f"Sensors {one + 1} and {other + 1} are swapped: exchange their channels in the config or their wires.",
        )
    loaded = estimate_mounting(pad, replace(tolerance, **LOADED), rest, bare, gains=gains)
    x, y, z = (loaded.rest.position_m - pad.rest_position_m) * 1e3
    tilt = np.arccos(np.clip(product(loaded.rest.axis, pad.rest_axis), -1.0, 1.0))
    yield _Suspicion(
        loaded,
        f"The magnet would be off by {x:+.2f}, {y:+.2f}, {z:+.2f} mm and {np.degrees(tilt):.1f}°: "
        "something presses on the pad, or rest_mm is not this pad's.",
    )
    if count < 4:
        return
    for sensor in range(count):
        used = np.arange(count) != sensor
        yield _Suspicion(
            estimate_mounting(pad, tolerance, rest, bare, used, gains),
            f"Sensor {sensor + 1} alone is wrong: a bad chip (run selftest), a bad place, or steel beside it.",
        )


def _reordered(recording: Recording, order: NDArray[np.intp]) -> Recording:
    return replace(
        recording, mean_t=recording.mean_t[order], noise_t=recording.noise_t[order], samples=recording.samples[order]
    )
