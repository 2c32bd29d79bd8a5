"""The compiled alignment against the history of each sensor, on random chips: late, missing, stuck and jumping ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

from fmfts.pose import Alignment
from oracle.field import Array
from oracle.sampling import JUMP_T, LONGEST_GAP_US, Chips, Flags, Times

PERIOD_US = 4545
Pushed = tuple[Array, Times, Flags, Flags | None, int | None]


def drifting(seed: int, count: int) -> Iterator[Pushed]:
    """Each chip has its own clock, which runs a few percent off; the field jumps once."""
    random = np.random.default_rng(seed)
    phase, own_us = random.uniform(0, PERIOD_US, count), PERIOD_US * random.uniform(0.97, 1.03, count)
    told, level, field = np.full(count, -1), np.zeros((count, 3)), np.zeros((count, 3))
    missing = random.random(count) * 0.1
    for frame in range(160):
        now_us = 10_000_000 + (frame + 1) * PERIOD_US
        sample = np.floor((now_us - phase) / own_us).astype(int)
        fresh = (sample != told) & ((random.random(count) > missing) | (frame < 3))
        if frame == 80:
            level = level + 3e-4 * random.normal(size=(count, 3))
        told = np.where(fresh, sample, told)
        noise = 2e-7 * np.rint(random.normal(size=(count, 3)))
        field = np.where(fresh[:, None], level + 1e-5 * np.sin(now_us * 1e-6 * 20.0 + np.arange(3)) + noise, field)
        yield field, np.rint(phase + told * own_us).astype(np.int64), fresh, None, None


def failing(seed: int, count: int) -> Iterator[Pushed]:
    """Lost and stale frames, chips that stop, silent axes, jumps, and a board whose clock begins again."""
    random = np.random.default_rng((seed, count))
    now, offset, step = 10_000_000, random.integers(0, PERIOD_US, count), random.choice([1e-9, 1e-7])
    field = random.normal(0.0, 1e-5, (count, 3))
    stopped = np.zeros(count, dtype=bool)
    time_us = now + offset
    for _ in range(400):
        kind = random.uniform()
        now += PERIOD_US if kind > 0.06 else int(random.choice([3, 8, 100]) * PERIOD_US)
        if kind > 0.99:
            now = max(now - 50 * PERIOD_US, 1)
        stopped ^= random.uniform(size=count) < 0.02
        fresh = (random.uniform(size=count) < random.choice([0.0, 0.8, 1.0], p=[0.15, 0.25, 0.6])) & ~stopped
        time_us = np.where(fresh | (random.uniform(size=count) < 0.05), now + offset, time_us)
        jump = random.uniform() < 0.05
        moved = field + random.normal(0.0, 2e-7, field.shape) + (3.0 * JUMP_T if jump else 0.0)
        field = np.where(random.uniform(size=field.shape) < 0.3, field, np.round(moved / step) * step)
        seen = np.where(random.uniform(size=field.shape) < 0.04, np.nan, field)
        seen[random.uniform(size=count) < 0.02] = np.nan
        timed = None if random.uniform() < 0.3 else random.uniform(size=count) < 0.97
        frame_us = None if random.uniform() < 0.3 else now + int(random.choice([0, 3, 6]) * PERIOD_US)
        yield seen, time_us.copy(), fresh, timed, frame_us


def compared(frames: Iterator[Pushed], count: int, rounding_t: float) -> Counter[str]:
    """Compare every frame with the histories. Returns how often each event occurred. rounding_t: of a parabola."""
    alignment, chips = Alignment(count, PERIOD_US), Chips(count, PERIOD_US)
    met: Counter[str] = Counter()
    before_us = 0
    for frame in frames:
        aligned, seen = alignment._push(*frame), chips.push(*frame)
        assert aligned.time_us == seen.instant_us
        assert (aligned.is_old, aligned.began_anew) == (seen.is_old, seen.began_anew)
        assert alignment.memory.without_news == chips.without_news
        np.testing.assert_allclose(aligned.field_t, seen.fields, rtol=1e-12, atol=1e-18)
        # A double has 16 digits of a field, a parabola less: a bend is a small difference.
        running = aligned.bend_t[seen.running]
        np.testing.assert_allclose(running, seen.bends[seen.running], rtol=1e-7, atol=rounding_t)
        if seen.running.any():
            assert not aligned.bend_t[~seen.running].any()
        told = seen.running & ~seen.lone
        np.testing.assert_allclose(aligned.noise_share[told, 0], seen.shares[told], rtol=1e-12)
        assert aligned.repeats.tolist() == [each.run.tolist() for each in chips.histories]
        met["bent"] += int((seen.bends > 0.8 * JUMP_T).sum())
        met["old"] += seen.is_old
        met["anew"] += seen.began_anew
        met["gap"] += seen.instant_us - before_us > LONGEST_GAP_US
        met["told nothing"] += not seen.running.any() and not seen.is_old
        met["jumped"] += bool((aligned.bend_t > JUMP_T / 2.0).any())
        met["repeated"] += bool((aligned.repeats > 1).any())
        met["between"] += bool((seen.shares[told] < 1.0).any())
        before_us = seen.instant_us
    return met


@pytest.mark.parametrize("seed", range(5))
def test_alignment_uses_each_sensors_history(seed: int) -> None:
    count = 4 + seed % 5
    assert compared(drifting(seed, count), count, rounding_t=1e-18)["bent"] > 5, "no field jumped"


@pytest.mark.parametrize("count", [1, 4, 8, 16])
@pytest.mark.parametrize("seed", range(3))
def test_alignment_of_failing_chips_uses_histories(count: int, seed: int) -> None:
    met = compared(failing(seed, count), count, rounding_t=1e-15)  # jumps add up to fields of millitesla
    # One sensor is at the instant itself: nothing lies between two of its samples.
    wanted = {"old", "anew", "gap", "repeated"} | ({"told nothing"} if count == 1 else {"jumped", "between"})
    assert {name for name, times in met.items() if times} >= wanted
