"""Small faults that last: what one frame's χ² lets through, a quarter of a second's mean residual shows.

A residual z − h(x̂) is seen through what no pose explains (the parity space, Q with QᵀWH = 0): there, to first order,
it is the same whatever the estimate, so a sensor that is left out goes on being judged. J. J. Gertler, "Survey of
model-based failure detection and isolation", IEEE Control Systems 8 (1988) 3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import cholesky, complement, lengths, log_determinant, product, solve, solve_lower
from fmfts.common.chi2 import quantile
from fmfts.common.double_table import Named

Array = NDArray[np.float64]

# The mean forgets over so many frames, 0.25 s at 220 Hz, and is judged once in so many.
MEMORY_FRAMES = 55
JUDGED_EVERY = 8
# Healthy judgements that are alarms. 27 a second, of which neighbours share most of their frames: once in ten hours.
FALSE_ALARM = 1e-6
# A mean as good as all but this share of healthy ones: nothing is wrong, or is any longer.
SOUND = 0.01
# What a single explanation must hold of the probability to be the answer.
CLEAR = 0.999
# What a broken axis is off by: a prior as wide as what one frame's gate may let through.
AXIS_FAULT_T = 1e-5


@dataclass(frozen=True, slots=True)
class Finding:
    """sensor: the one to blame; foreign: a field from elsewhere explains it better; neither: not clear which."""

    chi2: float
    sensor: int | None = None
    foreign: bool = False
    suspects: tuple[int, ...] = ()


class Innovations:
    """The mean residual of each axis, and what it says. noise_t (N, 3): white noise of one sample."""

    def __init__(self, noise_t: Array) -> None:
        self._noise = noise_t.ravel()
        self._mean = np.zeros(self._noise.shape)
        self._lasting = np.zeros(self._noise.shape)  # variance that no averaging takes away
        self._frames = np.zeros(self._noise.shape)  # seen of each axis, up to the memory
        self.change = np.zeros(8)  # the mean
        self._pushed = 0
        self._since = 0
        self.sound = True  # at the last judgement
        self.misfit = 1.0  # then: χ² over what a sound mean stays under, at least 1; of a mean that is no alarm

    def write(self, memory: Named) -> None:
        """For the compiled path."""
        memory.put("mean_t", self._mean)
        memory.put("lasting_t2", self._lasting)
        memory.put("frames", self._frames)
        memory.put("change", self.change)
        memory.put("pushed", self._pushed)
        memory.put("since", self._since)
        memory.put("sound", self.sound)
        memory.put("lasting_misfit", self.misfit)
        memory.put("was_sound", False)

    def read(self, memory: Named) -> None:
        """What `write` wrote, and the compiled path went on with."""
        count = len(self._noise)
        self._mean[:], self._lasting[:] = memory["mean_t"][:count], memory["lasting_t2"][:count]
        self._frames = memory["frames"][:count].copy()
        self.change[:], self._pushed = memory["change"], int(memory.number("pushed"))
        self._since, self.sound = int(memory.number("since")), bool(memory.number("sound"))
        self.misfit = memory.number("lasting_misfit")

    def forget(self) -> None:
        self._mean[:], self._frames[:], self._pushed = 0.0, 0.0, 0

    def push(self, residual_t: Array, lasting_t: Array, change: Array) -> bool:
        """One frame's residual (N, 3), NaN where an axis is silent; lasting_t (N, 3): deviation of the part of its
        error that stays from frame to frame, whatever the cause; change (8,): what errors are proportional to.
        True when it is time to judge."""
        residual, lasting = residual_t.ravel(), square(lasting_t.ravel())
        self._pushed = min(self._pushed + 1, MEMORY_FRAMES)
        self.change += (change - self.change) / self._pushed
        seen = np.isfinite(residual)
        self._frames = np.where(seen, np.minimum(self._frames + 1.0, MEMORY_FRAMES), 0.0)
        share = 1.0 / np.maximum(self._frames, 1.0)
        self._mean += np.where(seen, share * (residual - self._mean), -self._mean)
        self._lasting += np.where(seen, share * (lasting - self._lasting), -self._lasting)
        self._since += 1
        return self._since % JUDGED_EVERY == 0

    def judge(self, jacobian: Array, tolerated: Array, foreign: Array, forgiving: bool) -> Finding | None:
        """None while the mean is that of healthy sensors. jacobian (3N, unknowns).

        tolerated, foreign (3N, K): patterns in tesla, of one deviation each, that nothing is wrong with (an error that
        is considered), and that a field from elsewhere makes. forgiving: something was found, and may be over.
        """
        ready = self._frames >= 2 * JUDGED_EVERY
        unknowns = jacobian.shape[1]
        freedom = int(ready.sum()) - unknowns
        self.misfit = 1.0
        if freedom < 1:
            return None
        # The running mean of n frames, and once the memory is full the exponential one, which holds 2·memory − 1.
        effective = np.where(self._frames < MEMORY_FRAMES, self._frames, 2 * MEMORY_FRAMES - 1.0)
        weight = 1.0 / np.sqrt(square(self._noise[ready]) / effective[ready] + self._lasting[ready])
        scaled = weight[:, None] * jacobian[ready]
        parity = complement(scaled / lengths(scaled.T)).T * weight
        spread = product(parity, tolerated[ready])
        parity = solve_lower(cholesky(np.eye(freedom) + product(spread, spread.T)), parity)
        seen = product(parity, self._mean[ready])
        chi2 = product(seen, seen)
        self.sound = chi2 < quantile(SOUND, freedom)
        if chi2 < quantile(SOUND if forgiving else FALSE_ALARM, freedom):
            self.misfit = max(chi2 / quantile(SOUND, freedom), 1.0)
            return None
        return _explained(seen, parity, foreign[ready], np.flatnonzero(ready) // 3, chi2)


def _explained(seen: Array, parity: Array, foreign: Array, sensor_of: NDArray[np.intp], chi2: float) -> Finding:
    """The explanation that holds nearly all of the probability, if it fits at all."""
    names: list[int | None] = []
    evidence, misfits = [], []
    for sensor, pattern in _explanations(parity, foreign, sensor_of):
        names.append(sensor)
        log_evidence, misfit = _evidence(seen, pattern)
        evidence.append(log_evidence)
        misfits.append(misfit)
    share = np.array([exp(one - max(evidence)) for one in evidence])
    share /= share.sum()
    best = int(np.argmax(share))
    blamed = names[best]
    held = sum(part for part, name in zip(share, names, strict=True) if name == blamed)
    fits = misfits[best] < quantile(FALSE_ALARM, len(seen))
    if fits and held > CLEAR:
        return Finding(chi2, sensor=blamed, foreign=blamed is None)
    suspects = {name for part, name in zip(share, names, strict=True) if part > 1.0 - CLEAR and name is not None}
    return Finding(chi2, foreign=not fits or not suspects, suspects=tuple(sorted(suspects)))


def _explanations(parity: Array, foreign: Array, sensor_of: NDArray[np.intp]) -> Iterator[tuple[int | None, Array]]:
    """Each axis alone, each sensor whole, and a field from elsewhere: whom it blames, and its patterns in parity."""
    for row in range(parity.shape[1]):
        yield int(sensor_of[row]), AXIS_FAULT_T * parity[:, row : row + 1]
    for sensor in np.unique(sensor_of):
        yield int(sensor), AXIS_FAULT_T * parity[:, sensor_of == sensor]
    yield None, product(parity, foreign)


def _evidence(seen: Array, pattern: Array) -> tuple[float, float]:
    """Log probability of what is seen if the patterns' sizes are normal with deviation one, and its χ² beyond them."""
    spread = np.eye(len(seen)) + product(pattern, pattern.T)
    misfit = product(seen, solve(spread, seen))
    return -0.5 * (misfit + log_determinant(spread)), misfit
