"""Aligns the clock of another machine's log with the clock of the frames: finds an offset and a rate.

Both show when the pad was pressed: the log by its force, the frames by the field's distance from rest. First the lag
with the best correlation is found over the whole session; then the lag of each stretch, because quartzes differ by tens
of parts per million (50 ppm are 0.18 s in an hour), and the straight line through those lags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fmfts.sensor import Frame
from fmfts_collect.errors import RefusedError
from fmfts_collect.machine_log import EDGE_S, Log

Array = NDArray[np.float64]

GRID_HZ = 200.0
LEAST_CORRELATION = 0.7  # the paper's plan with a noisy gauge and a drifting ambient field: 0.86
# Largest correlation of any lag outside the peak, relative to the peak: regular presses fit at every period.
AMBIGUOUS = 0.97
PEAK_S = 0.5  # half width of the peak: no stretch may have a lag that differs more from that of the whole session
STRETCH_S = 30.0  # long enough for some presses
EVEN_S = 0.5 * EDGE_S  # largest distance of a stretch's lag from the straight line
LEAST_SHARE_EVEN = 0.8
# Force and field enter as log(1 + value / small): a touch in a corner changes the field a seventieth as much as one in
# the centre, and both must count as presses.
SMALL_FORCE_N, SMALL_FIELD_T = 0.1, 1e-6


@dataclass(frozen=True, slots=True)
class Alignment:
    """The frames' time minus the log's: `lag_s` at the log's time `middle_s`; it grows by `rate` seconds per second.

    correlation: at the best lag of the whole session; 1 is perfect. even: share of the stretches that fit the line.
    """

    lag_s: float
    rate: float
    middle_s: float
    correlation: float
    even: float

    def frame_time_s(self, log_time_s: float) -> float:
        return log_time_s + self.lag_s + self.rate * (log_time_s - self.middle_s)


def align(log: Log, frames: Sequence[Frame], rest_t: Array) -> Alignment:
    """The alignment of a log with frames. rest_t (N, 3): field of the untouched pad, in T.

    Raises RefusedError where no alignment is certain.
    """
    frame_s = np.array([frame.host_time_ns for frame in frames]) * 1e-9
    field_t = np.array([frame.field_t for frame in frames]).reshape(len(frames), -1)
    from_rest_t = np.linalg.norm(np.nan_to_num(field_t - rest_t.ravel()), axis=1)
    force_n = np.abs(log.force_n - np.percentile(log.force_n, 5))
    pressing, begun_s = np.log1p(force_n / SMALL_FORCE_N), float(log.time_s[0])
    moved = _on_grid(frame_s, np.log1p(from_rest_t / SMALL_FIELD_T))
    rate = 0.0
    for _ in range(2):  # a difference in rate blurs the correlation of a stretch: repeat with the rate corrected
        pressed = _on_grid(begun_s + (1.0 + rate) * (log.time_s - begun_s), pressing)
        lag, correlation = _lag_of_the_whole(pressed, moved)
        middle_s, lag_s = np.array(_lags_of_stretches(pressed, moved, lag) or [(0.0, lag / GRID_HZ)]).T
        slope, at_zero_s = _straight_line(middle_s, lag_s)
        even = float(np.mean(np.abs(lag_s - at_zero_s - slope * middle_s) < EVEN_S))
        rate += slope * (1.0 + rate)
    if even < LEAST_SHARE_EVEN:
        raise RefusedError(
            f"the clocks of log and frames do not run evenly: in {1.0 - even:.0%} of the stretches of {STRETCH_S:g} s "
            f"the log is more than {EVEN_S * 1e3:.0f} ms off the straight line: does the log miss rows?"
        )
    return Alignment(at_zero_s + float(frame_s[0]) - begun_s, rate, begun_s, correlation, even)


def _lag_of_the_whole(pressed: Array, moved: Array) -> tuple[int, float]:
    """The best lag, in steps of the grid, and its correlation."""
    size = 1 << int(np.ceil(np.log2(len(pressed) + len(moved))))
    product = np.fft.rfft(moved, size) * np.conj(np.fft.rfft(pressed, size))
    correlation = np.fft.irfft(product, size) / (np.linalg.norm(pressed) * np.linalg.norm(moved) or 1.0)
    best = int(np.argmax(correlation))
    peak = float(correlation[best])
    if peak < LEAST_CORRELATION:
        raise RefusedError(
            f"log and frames correlate by {peak:.2f} at best, less than {LEAST_CORRELATION:g}: are they of one session?"
        )
    away_from_peak = np.abs((np.arange(size) - best + size // 2) % size - size // 2) > PEAK_S * GRID_HZ
    second = float(correlation[away_from_peak].max())
    if second > AMBIGUOUS * peak:
        raise RefusedError(
            f"log and frames fit as well at another lag (correlation {second:.3f} beside {peak:.3f}): press once in an "
            "irregular rhythm at the beginning"
        )
    return best if best < size // 2 else best - size, peak


def _lags_of_stretches(pressed: Array, moved: Array, lag: int) -> list[tuple[float, float]]:
    """The middle and the lag of each stretch in s, the middle since the log began. Leaves out stretches with few
    presses.
    """
    reach = round(PEAK_S * GRID_HZ)
    number = max(round(len(pressed) / (STRETCH_S * GRID_HZ)), 1)
    edges = np.linspace(0, len(pressed), number + 1).astype(int)
    lags = []
    for first, last in pairwise(edges.tolist()):
        begin, end = max(first, reach - lag), min(last, len(moved) - lag - reach)
        if end - begin < reach:
            continue
        windows = sliding_window_view(moved[begin + lag - reach : end + lag + reach], end - begin)
        stretch = pressed[begin:end] - pressed[begin:end].mean()
        correlation = windows @ stretch / (np.linalg.norm(stretch) * windows.std(axis=1) * np.sqrt(end - begin) + 1e-12)
        best = int(np.argmax(correlation))
        if correlation[best] >= LEAST_CORRELATION and 0 < best < 2 * reach:
            lag_s = (lag - reach + best + _vertex(correlation, best)) / GRID_HZ
            lags.append((0.5 * (begin + end) / GRID_HZ, lag_s))
    return lags


def _straight_line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and intercept by medians (Theil–Sen), which a wrongly aligned stretch does not change."""
    first, second = np.triu_indices(len(x), 1)
    slope = float(np.median((y[second] - y[first]) / (x[second] - x[first]))) if len(first) else 0.0
    return slope, float(np.median(y - slope * x))


def _on_grid(time_s: Array, value: Array) -> Array:
    """`value` resampled at GRID_HZ, minus its mean."""
    grid = np.arange(time_s[0], time_s[-1], 1.0 / GRID_HZ)
    even = np.interp(grid, time_s, value)
    centred: Array = even - even.mean()
    return centred


def _vertex(values: Array, at: int) -> float:
    """Vertex of the parabola through the values at `at` − 1, `at` and `at` + 1, relative to `at`: −½ to ½."""
    before, here, after = values[at - 1 : at + 2].tolist()
    curvature = before - 2.0 * here + after
    return 0.0 if curvature == 0.0 else 0.5 * (before - after) / curvature
