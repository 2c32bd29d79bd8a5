"""Finds small faults that last: the mean residual of a quarter of a second shows what one frame's χ² does not.

A residual z − h(x̂) is projected on the parity space, which no pose can change (Q with QᵀWH = 0). There it does not
depend on the estimate, to first order, so a sensor that is left out is still judged. J. J. Gertler, "Survey of
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

Array = NDArray[np.float64]

# The mean forgets over MEMORY_FRAMES (0.25 s at 220 Hz), and is judged once in JUDGED_EVERY frames.
MEMORY_FRAMES = 55
JUDGED_EVERY = 8
# The share of healthy judgements that raise an alarm: once in ten hours, at 27 judgements a second that share frames.
FALSE_ALARM = 1e-6
# A mean is sound if its χ² is below the one that only this share of healthy means exceeds.
SOUND = 0.01
# The share of the probability that one explanation needs to be the answer.
CLEAR = 0.999
# Prior deviation of a broken axis: as wide as an error that the gate of one frame may let through.
AXIS_FAULT_T = 1e-5


@dataclass(frozen=True, slots=True)
class Finding:
    """sensor: the faulty one. foreign: a foreign field explains it better. Neither: unclear which of `suspects`."""

    chi2: float
    sensor: int | None = None
    foreign: bool = False
    suspects: tuple[int, ...] = ()


@dataclass(slots=True)
class MeanResidualsMemory:
    """Of each axis (3N,): mean_t, the mean residual; lasting_t2, variance that averaging does not reduce; frames, how
    many were averaged, up to MEMORY_FRAMES. change (8,): mean of `change_since`. sound: whether the last judged mean
    was. lasting_misfit: χ² of that mean over the limit of a sound one; at least 1, and 1 after an alarm. recent_t,
    recent: mean and number of the frames since the last judgement, while a fault is known."""

    mean_t: Array
    lasting_t2: Array
    frames: Array
    change: Array
    pushed: int = 0
    since: int = 0
    sound: bool = True
    lasting_misfit: float = 1.0
    recent_t: Array | None = None
    recent: int = 0


class MeanResiduals:
    """Averages the residual of each axis, and judges the means. noise_t (N, 3): white noise of one sample."""

    def __init__(self, noise_t: Array) -> None:
        self._noise = noise_t.ravel()
        axes = self._noise.shape
        self.memory = MeanResidualsMemory(np.zeros(axes), np.zeros(axes), np.zeros(axes), np.zeros(8))

    def forget(self) -> None:
        memory = self.memory
        memory.mean_t[:], memory.frames[:], memory.pushed = 0.0, 0.0, 0
        memory.recent_t, memory.recent = np.zeros(memory.mean_t.shape), 0

    def push(self, residual_t: Array, lasting_t: Array, change: Array) -> bool:
        """Add one frame. Returns True when it is time to judge.

        residual_t (N, 3): NaN where an axis is silent. lasting_t (N, 3): deviation of the part of its error that stays
        from frame to frame. change (8,): pose and ambient field since rest, to which errors are proportional.
        """
        memory, residual, lasting = self.memory, residual_t.ravel(), square(lasting_t.ravel())
        memory.pushed = min(memory.pushed + 1, MEMORY_FRAMES)
        memory.change += (change - memory.change) / memory.pushed
        seen = np.isfinite(residual)
        memory.frames = np.where(seen, np.minimum(memory.frames + 1.0, MEMORY_FRAMES), 0.0)
        share = 1.0 / np.maximum(memory.frames, 1.0)
        memory.mean_t += np.where(seen, share * (residual - memory.mean_t), -memory.mean_t)
        memory.lasting_t2 += np.where(seen, share * (lasting - memory.lasting_t2), -memory.lasting_t2)
        memory.recent += 1
        before = np.zeros(residual.shape) if memory.recent_t is None else memory.recent_t
        memory.recent_t = before + (residual - before) / memory.recent
        memory.since += 1
        return memory.since % JUDGED_EVERY == 0

    def judge(self, jacobian: Array, tolerated: Array, foreign: Array, forgiving: bool) -> Finding | None:
        """What is wrong, None if the mean is that of healthy sensors. jacobian (3N, unknowns).

        tolerated, foreign (3N, K): error patterns in tesla, one deviation each, of expected errors and of a foreign
        field. forgiving: a fault was found before, and counts as over only once the mean is sound.
        """
        memory = self.memory
        ready = memory.frames >= 2 * JUDGED_EVERY
        unknowns = jacobian.shape[1]
        freedom = int(ready.sum()) - unknowns
        memory.lasting_misfit = 1.0
        recent_t, recent = memory.recent_t, memory.recent
        memory.recent_t, memory.recent = np.zeros(memory.mean_t.shape), 0
        if freedom < 1:
            return None
        # A mean of n frames; once the memory is full, an exponential mean, which is worth 2·memory − 1 frames.
        effective = np.where(memory.frames < MEMORY_FRAMES, memory.frames, 2 * MEMORY_FRAMES - 1.0)
        weight = 1.0 / np.sqrt(square(self._noise[ready]) / effective[ready] + memory.lasting_t2[ready])
        parity = _parity(jacobian[ready], tolerated[ready], weight)
        seen = product(parity, memory.mean_t[ready])
        chi2 = product(seen, seen)
        memory.sound = bool(chi2 < quantile(SOUND, freedom))
        if (
            forgiving
            and recent == JUDGED_EVERY
            and recent_t is not None
            and self._is_over(recent_t, jacobian, tolerated)
        ):
            self.forget()
            return None
        if chi2 < quantile(SOUND if forgiving else FALSE_ALARM, freedom):
            memory.lasting_misfit = max(chi2 / quantile(SOUND, freedom), 1.0)
            return None
        return _explained(seen, parity, foreign[ready], np.flatnonzero(ready) // 3, chi2)

    def _is_over(self, recent_t: Array, jacobian: Array, tolerated: Array) -> bool:
        """Whether a fault that was found ended: the last frames are sound, and would not be with the mean's residuals.

        Without this a large fault outlives its cause by the seconds in which the mean forgets it. A small one is not
        seen in so few frames.
        """
        seen = np.isfinite(recent_t)
        freedom = int(seen.sum()) - jacobian.shape[1]
        if freedom < 1:
            return False
        weight = 1.0 / np.sqrt(square(self._noise[seen]) / JUDGED_EVERY + self.memory.lasting_t2[seen])
        parity = _parity(jacobian[seen], tolerated[seen], weight)
        now, before = product(parity, recent_t[seen]), product(parity, self.memory.mean_t[seen])
        sound = product(now, now) < quantile(SOUND, freedom)
        return bool(sound and product(before, before) > quantile(FALSE_ALARM, freedom))


def _parity(jacobian: Array, tolerated: Array, weight: Array) -> Array:
    """The parity space of rows with these weights, in which errors that are expected have deviation 1."""
    scaled = weight[:, None] * jacobian
    parity = complement(scaled / lengths(scaled.T)).T * weight
    spread = product(parity, tolerated)
    return solve_lower(cholesky(np.eye(len(spread)) + product(spread, spread.T)), parity)


def _explained(seen: Array, parity: Array, foreign: Array, sensor_of: NDArray[np.intp], chi2: float) -> Finding:
    """Compare the explanations, and blame the one that holds nearly all of the probability, if it fits."""
    names: list[int | None] = []
    evidence, misfits = [], []
    for sensor, pattern in _explanations(parity, foreign, sensor_of):
        names.append(sensor)
        log_evidence, misfit = _evidence(seen, pattern)
        evidence.append(log_evidence)
        misfits.append(misfit)
    probability = np.array([exp(one - max(evidence)) for one in evidence])
    probability /= probability.sum()
    best = int(np.argmax(probability))
    blamed = names[best]
    held = sum(part for part, name in zip(probability, names, strict=True) if name == blamed)
    fits = misfits[best] < quantile(FALSE_ALARM, len(seen))
    if fits and held > CLEAR:
        return Finding(chi2, sensor=blamed, foreign=blamed is None)
    suspects = {name for part, name in zip(probability, names, strict=True) if part > 1.0 - CLEAR and name is not None}
    return Finding(chi2, foreign=not fits or not suspects, suspects=tuple(sorted(suspects)))


def _explanations(parity: Array, foreign: Array, sensor_of: NDArray[np.intp]) -> Iterator[tuple[int | None, Array]]:
    """Each single axis, each whole sensor, and a foreign field: the blamed sensor, and its patterns in parity space."""
    for row in range(parity.shape[1]):
        yield int(sensor_of[row]), AXIS_FAULT_T * parity[:, row : row + 1]
    for sensor in np.unique(sensor_of):
        yield int(sensor), AXIS_FAULT_T * parity[:, sensor_of == sensor]
    yield None, product(parity, foreign)


def _evidence(seen: Array, pattern: Array) -> tuple[float, float]:
    """Log probability of `seen` if the sizes of the patterns are normal with deviation 1, and the remaining χ²."""
    spread = np.eye(len(seen)) + product(pattern, pattern.T)
    misfit = product(seen, solve(spread, seen))
    return -0.5 * (misfit + log_determinant(spread)), misfit
