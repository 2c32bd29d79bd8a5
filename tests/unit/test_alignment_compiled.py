"""The C of the alignment against its NumPy: the same bits, whatever comes from the chips."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from fmfts.pose import Aligned
from fmfts.pose.alignment import JUMP_T, LONGEST_GAP_US, Alignment, has_jumped
from twins.alignment import NumPyAlignment

PERIOD_US = 4545
FRAMES = 400


def bits(*arrays: np.ndarray) -> list[bytes]:
    """All NaN are one."""
    return [np.where(np.isnan(array), np.nan, array).tobytes() for array in arrays]


def of_aligned(one: Aligned) -> tuple[object, ...]:
    return *bits(one.field_t, one.noise_share, one.bend_t, one.repeats), one.time_us, one.is_old, one.began_anew


def frames_of(random: np.random.Generator, count: int) -> list[tuple[np.ndarray | int | None, ...]]:
    """Arguments of push(): chips on their own clocks, lost and stale frames, silent axes, jumps, resets."""
    frames: list[tuple[np.ndarray | int | None, ...]] = []
    now, offset, step = 10_000_000, random.integers(0, PERIOD_US, count), random.choice([1e-9, 1e-7])
    field = random.normal(0.0, 1e-5, (count, 3))
    stopped = np.zeros(count, dtype=bool)
    time_us = now + offset
    for _ in range(FRAMES):
        kind = random.uniform()
        now += PERIOD_US if kind > 0.06 else int(random.choice([3, 8, 100]) * PERIOD_US)
        if kind > 0.99:
            now = max(now - 50 * PERIOD_US, 1)  # the board's clock began again
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
        frames.append((seen, time_us.copy(), fresh, timed, frame_us))
    return frames


@pytest.mark.parametrize("count", [1, 4, 8, 16])
@pytest.mark.parametrize("seed", range(3))
def test_alignment_has_the_same_bits_in_c(count: int, seed: int) -> None:
    random = np.random.default_rng((seed, count))
    compiled, reference = Alignment(count, PERIOD_US), NumPyAlignment(count, PERIOD_US)
    met: Counter[str] = Counter()
    before_us = 0
    for number, frame in enumerate(frames_of(random, count)):
        there, here = compiled._push(*frame), reference._push(*frame)  # type: ignore[arg-type]
        assert of_aligned(there) == of_aligned(here), number
        assert there.noise_share.shape == here.noise_share.shape == (count, 1)
        one, other = compiled.memory, reference.memory
        assert bits(one.field_t, one.time_us, one.repeats) == bits(other.field_t, other.time_us, other.repeats), number
        assert one.without_news == other.without_news
        met["old"] += here.is_old
        met["anew"] += here.began_anew
        met["gap"] += here.time_us - before_us > LONGEST_GAP_US
        met["told nothing"] += bool(np.isnan(here.field_t).all()) and not here.is_old
        met["jumped"] += has_jumped(here)
        met["repeated"] += bool((here.repeats > 1).any())
        met["between"] += bool((here.noise_share < 1.0).any())
        before_us = here.time_us
    # One sensor is at the instant itself: nothing is between two of its samples.
    wanted = {"old", "anew", "gap", "repeated"} | ({"told nothing"} if count == 1 else {"jumped", "between"})
    assert {name for name, times in met.items() if times} >= wanted


def test_c_refuses_a_frame_of_another_number_of_sensors_and_changes_nothing() -> None:
    alignment = Alignment(4, PERIOD_US)
    alignment.push(np.ones((4, 3)), np.full(4, 1000), np.ones(4, dtype=bool))
    before = alignment.memory.time_us.copy()
    with pytest.raises(ValueError, match="array 0 has 288 bytes, 360 expected for 5 sensors"):
        alignment.push(np.ones((5, 3)), np.full(5, 6000), np.ones(5, dtype=bool))
    assert (alignment.memory.time_us == before).all()
