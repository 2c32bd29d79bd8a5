"""Faults of frames, in whole numbers: each fault is an episode of a world, stored with its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(slots=True)
class Stream:
    """The frames of one pad, as arrays over frames. temperature: a number into `temperatures_c`, −1 for None."""

    sequence: NDArray[np.int64]
    device_time_us: NDArray[np.int64]
    host_time_ns: NDArray[np.int64]
    counts: NDArray[np.int64]
    age_us: NDArray[np.int64]
    fresh: NDArray[np.int64]
    valid: NDArray[np.int64]
    temperature: NDArray[np.int64]


def apply(stream: Stream, faults: Sequence[Sequence[Any]], largest: int, saturated: int) -> NDArray[np.bool_]:
    """Change the frames. faults: (kind, first frame, frame after the last, arguments…). Returns which frames arrive."""
    arrive = np.ones(len(stream.sequence), np.bool_)
    counts, untellable = stream.counts, []
    for kind, first, end, *args in faults:
        span = slice(first, end)
        number = np.arange(first, min(end, len(arrive)))
        if kind == "stuck":
            counts[span, args[0], args[1]] = counts[first, args[0], args[1]]
        elif kind == "offset":
            counts[span, args[0], args[1]] += args[2]
        elif kind == "gain":
            counts[span, args[0], args[1]] = counts[span, args[0], args[1]] * args[2] // 1000
        elif kind == "spike":
            counts[number[number % args[3] == 0], args[0], args[1]] += args[2]
        elif kind == "saturated":
            counts[span, args[0], args[1]] = saturated
        elif kind == "untellable":  # a count that the chip cannot give
            untellable.append((span, args))
        elif kind == "silent":
            stream.valid[span, args[0]] = 0
        elif kind == "old":  # the sensor's samples are repeated
            stream.fresh[number[number % args[1] > 0], args[0]] = 0
        elif kind == "lost":  # frames that never arrive
            arrive[number[number % args[0] < args[1]]] = False
        elif kind == "field":  # a field of the surroundings, as every sensor reads it
            counts[span] += np.array(args)
        elif kind == "gradient":  # the gradient of a thing near one sensor: (N, 3) numbers
            counts[span] += np.array(args).reshape(counts.shape[1:])
        elif kind == "swapped":
            counts[span, [args[0], args[1]]] = counts[span, [args[1], args[0]]]
        elif kind == "reset":  # of the board's clock
            stream.device_time_us[first:] -= stream.device_time_us[first] - 1000
            stream.age_us[first] = 0
        elif kind == "leap":  # a leap of the board's clock, by this many µs
            stream.device_time_us[first:] += args[0]
        elif kind == "stands":  # the board's clock, which then continues as if it had not leapt
            stream.device_time_us[span] = stream.device_time_us[first]
        elif kind == "suspended":  # the host, whose clock stands still for this many ns
            stream.host_time_ns[first:] -= args[0]
        elif kind == "cold":  # no thermometer
            stream.temperature[span] = -1
        elif kind == "as warm":  # as in another frame
            stream.temperature[span] = stream.temperature[args[0]]
        else:
            raise ValueError(f"unknown fault {kind}")
    told = counts != saturated
    counts[told & (np.abs(counts) > largest)] = saturated
    for span, (sensor, axis, count) in untellable:
        counts[span, sensor, axis] = count
    return arrive
