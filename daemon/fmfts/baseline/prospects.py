"""The predicted gain of a self-test, --turn or --refine for this pad."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import inverse
from fmfts.baseline.accuracy import accuracy
from fmfts.baseline.mounting import Mounting
from fmfts.baseline.sensitivity import relative_covariance
from fmfts.pad import Pad

Array = NDArray[np.float64]

# A chip's remaining errors: lab/results/as-built.md. A turn and presses compare the chips with each other.
SELFTEST_GAIN = 0.005
TURN_GAIN, TURN_ROTATION_RAD, TURN_CROSS_AXIS = 0.006, 0.0015, 0.0025
REFINE_PLACE_M, REFINE_GAIN, REFINE_ROTATION_RAD, REFINE_CROSS_AXIS = 1.2e-4, 0.02, 0.012, 0.005
# The smallest gain worth the effort: a tenth.
WORTH = 0.9


def prospects(mounting: Mounting, pad: Pad) -> list[str]:
    """The gain of each step that reduces the deviation of the magnet's movement in a press of 1 N by at least a tenth,
    easiest first.

    The figures are deviations of that movement. Place and force of the press have more, because the contact model has
    errors of its own.
    """
    now = accuracy(mounting, pad)
    if not now:
        return []
    told = []
    for name, information in _steps(mounting, pad.chip.bias_strap is not None):
        then = accuracy(_informed(mounting, information), pad)
        if min(then[key] / now[key] for key in ("press_1n_sideways_sd_m", "press_1n_force_sd_n")) < WORTH:
            (then_n, then_m), (now_n, now_m) = _figures(then), _figures(now)
            told.append(
                f"{name}: sideways {then_m} instead of {now_m}; in depth, as a force, {then_n} instead of {now_n}, "
                "without the silicone's stiffness"
            )
    return told


def _figures(facts: dict[str, float]) -> tuple[str, str]:
    return f"±{facts['press_1n_force_sd_n']:.3f} N", f"±{facts['press_1n_sideways_sd_m'] * 1e6:.0f} µm"


def _steps(mounting: Mounting, has_selftest: bool) -> Iterator[tuple[str, Array]]:
    """Each step with the information (M, M) that it adds, in SI."""
    count = len(mounting.gain)
    size, first = 9 + 12 * count, 9 + 3 * count

    def of(place_m: float, gain: float, rotation_rad: float, cross_axis: float, *, apart: bool) -> Array:
        information = np.zeros((size, size))
        each = np.repeat([1.0 / square(one) if one else 0.0 for one in (gain, rotation_rad, cross_axis)], 3 * count)
        scale = np.sqrt(each)
        chips = relative_covariance(np.eye(9 * count)) if apart else np.eye(9 * count)
        information[first:, first:] = chips * scale * scale[:, None]
        if place_m:
            information[range(9, first), range(9, first)] = 1.0 / square(place_m)
        return information

    if has_selftest:
        yield "selftest", of(0.0, SELFTEST_GAIN, 0.0, 0.0, apart=False)
    yield "--turn", of(0.0, TURN_GAIN, TURN_ROTATION_RAD, TURN_CROSS_AXIS, apart=True)
    yield "--refine", of(REFINE_PLACE_M, REFINE_GAIN, REFINE_ROTATION_RAD, REFINE_CROSS_AXIS, apart=True)


def _informed(mounting: Mounting, information: Array) -> Mounting:
    leftover = mounting.leftover
    assert leftover is not None  # accuracy was not empty
    scale = leftover.unknowns.deviation
    normal = inverse(leftover.covariance) + information * scale * scale[:, None]
    return replace(mounting, leftover=replace(leftover, covariance=inverse(normal)))
