"""Processor time of single calls: what a frame costs, whatever else the machine does meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import thread_time_ns
from typing import Any, NamedTuple, TypeVar

import numpy as np

Asked = TypeVar("Asked")


class Cost(NamedTuple):
    """Microseconds a call."""

    median_us: float
    p99_us: float


def timed(call: Callable[[Asked], Any], samples: Sequence[Asked], then: Callable[[Any], Any]) -> tuple[list[Any], Cost]:
    """What `then` makes of `call`'s result for each sample, and what `call` costs, less a look at the clock."""
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
