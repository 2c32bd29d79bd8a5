"""Possible faults of a pad whose field fits no pad within the tolerances: assumptions, each with a sentence.

Each assumption is one model of pad and recordings; two of them combine to a third. Models are compared by their
evidence: D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415. If several explain a field, it
prefers the one with the fewest free parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import lengths, product, root_of_squares
from fmfts.baseline.mounting import Mounting, estimate_mounting
from fmfts.baseline.recording import Recording
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.pad import Pad, SensorArray, Tolerance, rotation_from_vector

Array = NDArray[np.float64]

# Prior deviations of faults, far beyond those of mounting: a finger, a wrong rest_mm or a wrong part.
ELSEWHERE_M, ELSEWHERE_RAD, REMANENCE, TURNED_RAD, GAIN = 2e-3, 0.2, 1.0, 0.2, 0.2
ALL_GAINS = 0.05
UNEXPLAINED_T = 3e-5  # steel or another magnet beside the pad, or a drawing that is not this pad's: any field
HAND_PLACED_DEG = 1.5, 5.0  # with care, and without
QUARTER = np.pi / 2.0


@dataclass(frozen=True, slots=True)
class Assumption:
    """An assumed pad, and how to read its recordings.

    order (N,): sensor i of the pad is the recording's sensor order[i]. used (N,): False for a sensor without
    information. beyond (9N,): deviations of sensitivities, besides those of the tolerances. unexplained_t: deviation of
    the unexplained field. alternatives: number of equivalent assumptions, so that each is less probable.
    """

    pad: Pad
    tolerance: Tolerance
    order: NDArray[np.intp]
    used: NDArray[np.bool_]
    beyond: Array
    unexplained_t: float = 0.0
    alternatives: int = 1
    sentences: tuple[Callable[[Mounting], str], ...] = ()

    @classmethod
    def of(cls, pad: Pad, tolerance: Tolerance) -> Assumption:
        count = len(pad.sensors)
        return cls(pad, tolerance, np.arange(count), np.ones(count, dtype=bool), np.zeros(9 * count))

    def mounting(self, rest: Recording, bare: Recording | None, measured: Sensitivity | None) -> Mounting:
        """The most probable mounting under this assumption."""
        known = measured or Sensitivity.untested(len(self.order), self.tolerance)
        widened = Sensitivity(known.mean, known.covariance + np.diag(square(self.beyond)))
        recordings = (
            _with_error(_reordered(rest, self.order), self.unexplained_t),
            bare and _reordered(bare, self.order),
        )
        return estimate_mounting(self.pad, self.tolerance, *recordings, self.used, widened, to_compare=True)

    def told(self, mounting: Mounting) -> str:
        return " ".join(sentence(mounting) for sentence in self.sentences)


Fault = Callable[[Assumption], Assumption]


def faults_alone(drawing: Pad) -> Iterator[Fault]:
    """Faults that explain so much that no second one is searched beside them."""
    yield _unexplained
    if len(drawing.sensors) > 3:
        for sensor in range(len(drawing.sensors)):
            yield partial(_useless, sensor=sensor)


def faults_in_company(drawing: Pad, tolerance: Tolerance) -> Iterator[Fault]:
    """Faults of which two may come together."""
    count = len(drawing.sensors)
    for rotation_deg in HAND_PLACED_DEG:
        yield partial(_all_turned, tolerance=tolerance, rotation_deg=rotation_deg)
    yield partial(_all_gains, tolerance=tolerance)
    yield _upside_down
    yield _mirrored
    yield _elsewhere
    yield _other_magnet
    for one, other in combinations(range(count), 2):
        yield partial(_swapped, one=one, other=other)
    for sensor in range(count):
        yield partial(_turned, sensor=sensor)
        for axis in range(3):
            yield partial(_gain_off, sensor=sensor, axis=axis)
            for quarters in (1, 2, 3):
                yield partial(_quarter, sensor=sensor, axis=axis, quarters=quarters)


def _with(
    before: Assumption, sentence: Callable[[Mounting], str], alternatives: int = 1, **changes: object
) -> Assumption:
    changes["alternatives"] = before.alternatives * alternatives
    return replace(before, sentences=(*before.sentences, sentence), **changes)  # type: ignore[arg-type]


def _unexplained(before: Assumption) -> Assumption:
    text = (
        "No single fault explains it, nor do two: steel or a magnet nearby, or sensors_mm, rest_mm and remanence_t "
        "in the config are not this pad's."
    )
    return _with(before, lambda _: text, unexplained_t=UNEXPLAINED_T)


def _upside_down(before: Assumption) -> Assumption:
    pad = replace(before.pad, rest_axis=-before.pad.rest_axis)
    return _with(before, lambda _: "The magnet is in upside down: turn it, or negate rest_axis.", pad=pad)


def _mirrored(before: Assumption) -> Assumption:
    pad = replace(before.pad, sensors=before.pad.sensors.mirrored())
    text = "The chips read z the other way round than `chip` says: invert geometry.sensors_mirrored."
    return _with(before, lambda _: text, pad=pad)


def _moved(mounting: Mounting, pad: Pad) -> str:
    x, y, z = (mounting.rest.position_m - pad.rest_position_m) * 1e3
    tilt = np.degrees(np.arccos(np.clip(product(mounting.rest.axis, pad.rest_axis), -1.0, 1.0)))
    return f"{x:+.2f}, {y:+.2f}, {z:+.2f} mm and {tilt:.1f}°"


def _elsewhere(before: Assumption) -> Assumption:
    def sentence(mounting: Mounting) -> str:
        off = _moved(mounting, before.pad)
        return (
            f"The magnet would be off by {off}: something presses on the pad, or rest_mm is not this pad's; or, if it "
            "was cast there, set tolerance.magnet_position_mm = 1 and tolerance.magnet_tilt_deg = 5."
        )

    tolerance = replace(before.tolerance, magnet_position_m=ELSEWHERE_M, magnet_tilt_rad=ELSEWHERE_RAD)
    return _with(before, sentence, tolerance=tolerance)


def _other_magnet(before: Assumption) -> Assumption:
    def sentence(mounting: Mounting) -> str:
        times = exp(mounting.rest.log_moment)
        how = f"{1.0 / times:.1f} times too weak" if times < 1.0 else f"{times:.1f} times too strong"
        return f"The magnet reads {how}: another magnet, or its remanence_t, size or rest_mm are wrong."

    return _with(before, sentence, tolerance=replace(before.tolerance, remanence=REMANENCE))


def _all_turned(before: Assumption, tolerance: Tolerance, rotation_deg: float) -> Assumption:
    def sentence(_: Mounting) -> str:
        return (
            "The chips are turned by more than tolerance.sensor_rotation_deg = "
            f"{np.degrees(tolerance.sensor_rotation_rad):.3g} allows: set it to {rotation_deg:g}, then --turn measures "
            "them."
        )

    count = len(before.order)
    beyond = before.beyond + np.repeat([0.0, np.radians(rotation_deg), 0.0], 3 * count)
    return _with(before, sentence, len(HAND_PLACED_DEG), beyond=beyond)


def _all_gains(before: Assumption, tolerance: Tolerance) -> Assumption:
    def sentence(_: Mounting) -> str:
        return (
            f"The gains are off by more than tolerance.gain = {tolerance.gain:g} allows: set it to {ALL_GAINS:g}, then "
            "selftest or --turn measures them."
        )

    beyond = before.beyond + np.repeat([ALL_GAINS, 0.0, 0.0], 3 * len(before.order))
    return _with(before, sentence, beyond=beyond)


def _swapped(before: Assumption, one: int, other: int) -> Assumption:
    order = before.order.copy()
    order[[one, other]] = order[[other, one]]
    text = f"Sensors {one + 1} and {other + 1} are swapped: exchange their channels in the config or their wires."
    count = len(order)
    return _with(before, lambda _: text, count * (count - 1) // 2, order=order)


def _turned(before: Assumption, sensor: int) -> Assumption:
    def sentence(mounting: Mounting) -> str:
        drawn, found = before.pad.sensors.axes[sensor], mounting.axes[sensor]
        angle = np.degrees(np.arccos(np.clip((product(drawn.T, found).trace() - 1.0) / 2.0, -1.0, 1.0)))
        return f"Sensor {sensor + 1} is turned by {angle:.0f}° against the drawing: mount it straight."

    beyond = before.beyond.copy()
    first = 3 * len(before.order) + 3 * sensor
    beyond[first : first + 3] += TURNED_RAD
    return _with(before, sentence, len(before.order), beyond=beyond)


def _gain_off(before: Assumption, sensor: int, axis: int) -> Assumption:
    def sentence(mounting: Mounting) -> str:
        gain, where = mounting.gain[sensor, axis], f"sensor {sensor + 1}, axis {'xyz'[axis]}"
        deviation = mounting.leftover.sensitivity_deviation[3 * sensor + axis] if mounting.leftover else np.nan
        return f"The gain of {where} would be {gain:.2f} ± {deviation:.2f}: a bad chip; run selftest."

    beyond = before.beyond.copy()
    beyond[3 * sensor + axis] += GAIN
    return _with(before, sentence, 3 * len(before.order), beyond=beyond)


def _quarter(before: Assumption, sensor: int, axis: int, quarters: int) -> Assumption:
    turn = rotation_from_vector(QUARTER * quarters * np.eye(3)[axis])
    axes = before.pad.sensors.axes.copy()
    axes[sensor] = product(np.round(turn), axes[sensor])  # sine and cosine of right angles
    pad = replace(before.pad, sensors=SensorArray(before.pad.sensors.position_m, axes))
    text = (
        f"Sensor {sensor + 1} is turned by {90 * quarters}° about {'xyz'[axis]}: turn its board, or correct "
        "sensor_rotations_deg."
    )
    return _with(before, lambda _: text, 9 * len(before.order), pad=pad)


def _useless(before: Assumption, sensor: int) -> Assumption:
    used = before.used.copy()
    used[sensor] = False
    text = f"Sensor {sensor + 1} alone is wrong: a bad chip (run selftest), a bad place, or steel beside it."
    return _with(before, lambda _: text, len(used), used=used)


def no_magnet(pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None) -> str:
    """A sentence with the figures where the field is as uniform as without a magnet; else ""."""
    field = rest.mean_t if bare is None else rest.mean_t - bare.mean_t
    seen = pad.sensors.to_pad(field)
    odd = float(lengths(seen - (seen.mean(axis=0) if bare is None else 0.0)).max())
    distance_m = float(lengths(pad.sensors.position_m - pad.rest_position_m).min())
    drawn = pad.magnet.strength_t_m3 / (distance_m * distance_m * distance_m)
    errors = (tolerance.gain + tolerance.sensor_rotation_rad) * float(lengths(rest.mean_t).max())
    if odd >= 0.02 * drawn + 3.0 * errors * (bare is None):
        return ""
    return f"the sensors see at most {odd * 1e6:.1f} µT of the {drawn * 1e6:.0f} µT that the configured magnet makes."


def _reordered(recording: Recording, order: NDArray[np.intp]) -> Recording:
    return replace(
        recording, mean_t=recording.mean_t[order], noise_t=recording.noise_t[order], samples=recording.samples[order]
    )


def _with_error(recording: Recording, error_t: float) -> Recording:
    """The recording with a further error of each mean, of deviation `error_t`."""
    return replace(recording, noise_t=root_of_squares(recording.noise_t, error_t * np.sqrt(recording.samples)[:, None]))
