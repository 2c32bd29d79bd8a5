"""Processor time of single calls: the cost of a frame, independent of other programs on the machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import thread_time_ns
from typing import Any, NamedTuple, TypeVar

import numpy as np

Asked = TypeVar("Asked")


class Cost(NamedTuple):
    """Microseconds per call."""

    median_us: float
    p99_us: float


def timed(call: Callable[[Asked], Any], samples: Sequence[Asked], then: Callable[[Any], Any]) -> tuple[list[Any], Cost]:
    """`then(call(sample))` for each sample, and the time of `call` minus that of reading the clock."""
    results, taken, empty = [], np.empty(len(samples)), np.empty(len(samples))
    for number, sample in enumerate(samples):
        begun = thread_time_ns()
        empty[number] = thread_time_ns() - begun
        begun = thread_time_ns()
        result = call(sample)
        taken[number] = thread_time_ns() - begun
        results.append(then(result))
    median, most = np.percentile(taken - np.median(empty), [50, 99]) * 1e-3
    return results, Cost(round(float(median), 2), round(float(most), 2))
