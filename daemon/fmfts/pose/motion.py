"""The magnet's pose and its rate at the newest sample, from each chip's samples at their own times.

`Tracker` solves for the pose at the newest instant that all chips have passed, some 4 ms ago; a tap moves on in that
time. This filter predicts to each sample instead: an extended Kalman filter of two modes. The magnet is STILL (its
rates die out) or MOVING (its acceleration is white noise, along the directions in which presses move the magnet).
After each frame the modes are merged into one state, so that the memory is one state, its covariance and two
probabilities (GPB1: Ackerson and Fu, IEEE Trans. Automatic Control 15 (1970) 10; Bar-Shalom, Li, Kirubarajan,
"Estimation with applications to tracking and navigation" (2001), chapter 11).

State x (13): change of the pose from rest (position in m, axis in the rest axis's tangent plane), its rates, and the
change of the ambient field since the baseline. Between samples, dt apart, with the drive W (5, 5) of MOVING:

    pose += g·rate, rate *= e
    MOVING: e = 1, g = dt;  STILL: e = exp(−dt/CALM_S), g = CALM_S·(1 − e)
    P += W·[dt³/3, dt²/2; dt²/2, dt]  (white acceleration: Bar-Shalom et al., chapter 6)

Each axis of a sample is one scalar measurement z = field + ambient along the axis, with h its derivative by x:

    s = hPhᵀ + r,  ν = z − ẑ,  x += Phᵀν/s,  P −= Phᵀ(Phᵀ)ᵀ/s,  mode's log likelihood −= (ν²/s + ln(s/r))/2

`motion.c` does the same; the order of its sums differs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, log, square
from fmfts.arithmetic.matrix import product
from fmfts.pad import Pad
from fmfts.pose.dipole import radial_of
from fmfts.pose.state import LOG_MOMENT, State, tangent_basis

Array = NDArray[np.float64]

STATES, POSE, RATE, AMBIENT_CHANGE = 13, slice(0, 5), slice(5, 10), slice(10, 13)
MODES = 2
EARLY_PLACES = 8  # of early_us at least: recordings of pads with fewer sensors hold so many, too
STILL, MOVING = range(MODES)
# How fast the rates die out while the pad is still.
CALM_S = 0.03
# 0 for a mode that is left out: `bench now --ablation` shows what each of them brings.
WEIGHTS = (1.0, 1.0)
# How often a mode gives way to each other one.
SWITCHES_PER_S = 30.0
# Share of the deviation that lasts (gains, places) that counts in each sample. In full it would slow the filter, which
# would take noise for larger than it is; without it, gains that are off would look like motion.
LASTING_SHARE = 0.5
# The filter begins with the solver's pose, which shares samples with the next frame: so much of its covariance.
FIRST_COVARIANCE = 4.0
# The variance of the first rates is that of the drive in this time.
FIRST_RATE_S = 0.02
# No press tilts a magnet so far (sine): a filter that says so has lost it.
LARGEST_TILT = 0.7
# Probability that the innovations of a healthy frame, or of a sample that came before its frame, are so unlikely. A
# sensor that begins to fail is seen here first.
FALSE_INNOVATION = 1e-6
# Boards read chips by turns, so that samples of two chips may come in the wrong order; older ones are not used.
LATE_US = 1000.0


class Samples(NamedTuple):
    """The newest sample of each of N chips. field_t (N, 3): the magnet's field in sensor axes, NaN without one;
    deviation_t (N, 3): what lasts of its errors. time_us (N,): board's clock. fresh (N,): not in an earlier frame."""

    field_t: Array
    deviation_t: Array
    time_us: NDArray[np.int64]
    fresh: NDArray[np.bool_]


@dataclass(slots=True)
class MotionMemory:
    """motion_us: time of the newest sample on the board's clock, 0 while the filter does not run.

    motion_state (13,), motion_covariance (13, 13): the merged state. modes (2,): probabilities. followed: frames
    since the filter began.

    The others are of samples that came before their frame, since the last frame; recordings of old versions lack them.
    early_us (N,), at least EARLY_PLACES: time of each sensor's newest, 0 before the first. early_from_us, early_modes:
    motion_us and modes after that frame. early_state (2, 13), early_covariance (2, 13, 13), early_chi2_sum and
    early_widths (2,): of each mode.
    """

    motion_us: float
    motion_state: Array
    motion_covariance: Array
    modes: Array
    followed: float
    early_us: Array = field(default_factory=lambda: np.zeros(EARLY_PLACES))
    early_from_us: float = 0.0
    early_modes: Array = field(default_factory=lambda: np.zeros(MODES))
    early_state: Array = field(default_factory=lambda: np.zeros((MODES, STATES)))
    early_covariance: Array = field(default_factory=lambda: np.zeros((MODES, STATES, STATES)))
    early_chi2_sum: Array = field(default_factory=lambda: np.zeros(MODES))
    early_widths: Array = field(default_factory=lambda: np.ones(MODES))


@dataclass(slots=True)
class _Modes:
    """The modes since the last frame. from_us, shares (2,): motion_us and probabilities then. x (2, 13), p (2, 13, 13).
    chi2 (2,): sum of ν²/s. widths (2,): product of s/r."""

    from_us: float
    shares: Array
    x: Array
    p: Array
    chi2: Array
    widths: Array


class MotionFilter:
    """Follows one magnet from sample to sample.

    pad: as mounted. noise_t (N, 3): of one sample. ambient_walk_t2_per_s (3,): variance of the ambient field's change,
    0 where it is constant. surprise_chi2: frames with larger innovations are not those of a healthy pad;
    early_chi2: the same of a sample that came before its frame.
    """

    def __init__(
        self,
        pad: Pad,
        rest: State,
        noise_t: Array,
        ambient_walk_t2_per_s: Array,
        surprise_chi2: float,
        early_chi2: float,
    ) -> None:
        self._pad, self._rest = pad, rest
        self._basis = tangent_basis(rest.axis)
        self._directions = pad.sensors.axes.transpose(0, 2, 1)
        self._noise_t2 = square(noise_t)
        self._walk = ambient_walk_t2_per_s
        self._surprise_chi2, self._early_chi2 = surprise_chi2, early_chi2
        self.memory = MotionMemory(0.0, np.zeros(STATES), np.zeros((STATES, STATES)), np.full(MODES, 1.0 / MODES), 0.0)
        self.memory.early_us = self._no_early()

    def forget(self) -> None:
        """Stop, until the next begin()."""
        self.memory.motion_us = 0.0

    def begin(self, time_us: int, change: Array, state: State, covariance: Array, drive: Array) -> None:
        """Begin with the solver's pose at `time_us`. change (5,): from rest. covariance (14, 14): of `state`."""
        memory = self.memory
        known = [*range(LOG_MOMENT), *range(LOG_MOMENT + 1, LOG_MOMENT + 4)]
        places = [*range(5), *range(AMBIENT_CHANGE.start, AMBIENT_CHANGE.stop)]
        memory.motion_us, memory.followed = float(time_us), 0.0
        memory.motion_state = np.concatenate([change, np.zeros(5), state.ambient_t])
        memory.motion_covariance = np.zeros((STATES, STATES))
        memory.motion_covariance[np.ix_(places, places)] = FIRST_COVARIANCE * covariance[np.ix_(known, known)]
        memory.motion_covariance[RATE, RATE] = FIRST_RATE_S * drive
        memory.modes, memory.early_us = np.full(MODES, 1.0 / MODES), self._no_early()

    def is_next(self, sensor: int, time_us: float) -> bool:
        """Whether a sample, after others that came before their frame, goes on from those that the filter took."""
        memory = self.memory
        return memory.motion_us > 0.0 and time_us > max(memory.early_us[sensor], memory.motion_us - LATE_US)

    def follow(self, samples: Samples, log_moment: float, drive: Array) -> bool:
        """Take the fresh samples of a frame, but for those that came before it. False if they contradict what was
        predicted: the filter has stopped then.

        drive (5, 5): W of MOVING, in the units of the state's pose. log_moment: as in `State`.
        """
        memory = self.memory
        if memory.early_us.any() and samples.time_us.max() <= memory.motion_us - LATE_US:
            self.forget()  # an old frame, sent again
            return False
        order = sorted(np.flatnonzero(samples.fresh).tolist(), key=lambda sensor: int(samples.time_us[sensor]))
        if memory.early_us.any():
            order = [sensor for sensor in order if self.is_next(sensor, float(samples.time_us[sensor]))]
        elif not order:
            return True
        modes = self._modes()
        if not self._take(modes, samples, order, log_moment, drive):
            return False
        memory.followed += 1.0
        memory.early_us = self._no_early()
        return self._is_sound(modes.chi2, self._surprise_chi2)

    def follow_early(self, samples: Samples, sensor: int, log_moment: float, drive: Array) -> bool:
        """Take one sensor's sample that came before its frame, and `is_next`. Otherwise as `follow`."""
        memory, modes = self.memory, self._modes()
        before = modes.chi2.copy()
        if not self._take(modes, samples, [sensor], log_moment, drive):
            return False
        memory.early_us[sensor] = float(samples.time_us[sensor])
        memory.early_from_us, memory.early_modes = modes.from_us, modes.shares
        memory.early_state, memory.early_covariance = modes.x, modes.p
        memory.early_chi2_sum, memory.early_widths = modes.chi2, modes.widths
        sound = self._is_sound(modes.chi2 - before, self._early_chi2)
        return sound and self._is_sound(modes.chi2, self._surprise_chi2)

    def _no_early(self) -> Array:
        return np.zeros(max(EARLY_PLACES, len(self._pad.sensors)))

    def _modes(self) -> _Modes:
        memory = self.memory
        if memory.early_us.any():
            chi2, widths = memory.early_chi2_sum.copy(), memory.early_widths.copy()
            x, p = memory.early_state.copy(), memory.early_covariance.copy()
            return _Modes(memory.early_from_us, memory.early_modes, x, p, chi2, widths)
        x, p = np.stack([memory.motion_state] * MODES), np.stack([memory.motion_covariance] * MODES)
        return _Modes(memory.motion_us, memory.modes, x, p, np.zeros(MODES), np.ones(MODES))

    def _take(self, modes: _Modes, samples: Samples, order: list[int], log_moment: float, drive: Array) -> bool:
        """Take the samples of these sensors in every mode, and merge. False if the filter is lost: it has stopped."""
        memory, x, p = self.memory, modes.x, modes.p
        newest_us = float(samples.time_us[order[-1]]) if order else memory.motion_us
        strength = self._pad.magnet.strength_t_m3 * exp(log_moment)
        for sensor in order:
            passed_s = (float(samples.time_us[sensor]) - memory.motion_us) * 1e-6
            if passed_s > 0.0:
                self._predict(x, p, passed_s, drive)
                memory.motion_us = float(samples.time_us[sensor])
            if not self._upright(x):
                self.forget()
                return False
            r = self._noise_t2[sensor] + square(LASTING_SHARE * samples.deviation_t[sensor])
            predicted, slope = self._predicted(x, sensor, strength)
            at = x.copy()
            for axis in range(3):
                value, model = float(samples.field_t[sensor, axis]), (predicted[:, axis], slope[:, axis])
                _measure(x, p, at, value, *model, float(r[axis]), modes.chi2, modes.widths)
        self._merge(modes, max(newest_us - modes.from_us, 0.0) * 1e-6)
        return True

    def _is_sound(self, chi2: Array, most: float) -> bool:
        """Whether the innovations are those of a healthy pad. If they are not, the filter stops."""
        if chi2.min() < most and self._upright(self.memory.motion_state[None]):
            return True
        self.forget()
        return False

    def _predict(self, x: Array, p: Array, passed_s: float, drive: Array) -> None:
        calm = exp(-passed_s / CALM_S)
        for mode, keeps, reach_s in ((STILL, calm, CALM_S * (1.0 - calm)), (MOVING, 1.0, passed_s)):
            x[mode, POSE] += reach_s * x[mode, RATE]
            x[mode, RATE] *= keeps
            own = p[mode]
            own[POSE] += reach_s * own[RATE]
            own[:, POSE] += reach_s * own[:, RATE]
            own[RATE] *= keeps
            own[:, RATE] *= keeps
        own = p[MOVING]
        square_s2 = passed_s * passed_s
        own[POSE, POSE] += square_s2 * passed_s / 3.0 * drive
        own[POSE, RATE] += square_s2 / 2.0 * drive
        own[RATE, POSE] += square_s2 / 2.0 * drive
        own[RATE, RATE] += passed_s * drive
        for mode in range(MODES):
            p[mode][[10, 11, 12], [10, 11, 12]] += self._walk * passed_s

    def _predicted(self, x: Array, sensor: int, strength: float) -> tuple[Array, Array]:
        """What the sensor's axes would read in each mode (2, 3), and the derivative by pose and ambient (2, 3, 8)."""
        directions, magnet = self._directions[sensor], self._pad.magnet
        position_m, axis, turn = self.pose(x[:, POSE])
        r = self._pad.sensors.position_m[sensor] - position_m
        radial = radial_of((r * axis).sum(axis=1), (r * r).sum(axis=1), magnet.modelled_octupole_m2)
        alpha, beta, alpha_u, beta_u, alpha_2q, beta_2q = (strength * value[:, None] for value in radial)
        along, across = product(axis, directions.T), product(r, directions.T)
        by_u, by_2q = alpha_u * along + beta_u * across, alpha_2q * along + beta_2q * across
        slope = np.empty((MODES, 3, 8))
        by_r = by_2q[:, :, None] * r[:, None] + beta[:, :, None] * directions
        slope[:, :, :3] = -(by_u[:, :, None] * axis[:, None] + by_r)
        turned = by_u[:, :, None] * r[:, None] + alpha[:, :, None] * directions
        slope[:, :, 3:5] = product(turned, turn)
        slope[:, :, 5:] = directions
        return alpha * along + beta * across + product(x[:, AMBIENT_CHANGE], directions.T), slope

    def pose(self, change: Array) -> tuple[Array, Array, Array]:
        """Position (…, 3) m, axis (…, 3) after a change (…, 5) from rest, and the derivative (…, 3, 2) of the axis."""
        rest, tilt = self._rest.axis, change[..., 3:]
        upright = np.sqrt(1.0 - (tilt * tilt).sum(axis=-1))[..., None]
        axis = upright * rest + (tilt[..., :1] * self._basis[:, 0] + tilt[..., 1:] * self._basis[:, 1])
        turn = self._basis - rest[:, None] * (tilt / upright)[..., None, :]
        return self._rest.position_m + change[..., :3], axis, turn

    @staticmethod
    def _upright(states: Array) -> bool:
        return bool((square(states[:, 3:5]).sum(axis=1) < square(LARGEST_TILT)).all())

    def _merge(self, modes: _Modes, elapsed_s: float) -> None:
        memory, each = self.memory, zip(modes.chi2, modes.widths, strict=True)
        likelihood = np.array([-0.5 * (misfit + log(width)) for misfit, width in each])
        # After a long gap every mode is as likely as the others, whichever it was before.
        leaves = min(1.0 - exp(-SWITCHES_PER_S * elapsed_s), 1.0 / MODES)
        stays = 1.0 - (MODES - 1) * leaves
        before = leaves * (modes.shares.sum() - modes.shares) + stays * modes.shares
        shares = before * np.array(WEIGHTS) * np.array([exp(one) for one in likelihood - likelihood.max()])
        memory.modes = shares / shares.sum()
        memory.motion_state = product(memory.modes, modes.x)
        off = modes.x - memory.motion_state
        spread = modes.p + off[:, :, None] * off[:, None, :]
        memory.motion_covariance = (memory.modes[:, None, None] * spread).sum(axis=0)


def _measure(
    x: Array, p: Array, at: Array, value: float, predicted: Array, slope: Array, r: float, chi2: Array, widths: Array
) -> None:
    """Take one scalar in all modes. at (2, 13): where `predicted` (2,) and `slope` (2, 8) were computed.

    chi2 (2,): sum of ν²/s. widths (2,): product of s/r.
    """
    seen = [*range(5), 10, 11, 12]
    moved = (x - at)[:, seen]
    spread = np.zeros((MODES, STATES))
    ahead, s = predicted.copy(), np.full(MODES, r)
    for index, state in enumerate(seen):
        spread += p[:, :, state] * slope[:, index, None]
        ahead += slope[:, index] * moved[:, index]
    for index, state in enumerate(seen):
        s += slope[:, index] * spread[:, state]
    innovation = value - ahead
    x += spread * (innovation / s)[:, None]
    p -= spread[:, :, None] * (spread / s[:, None])[:, None, :]
    chi2 += innovation * innovation / s
    widths *= s / r
