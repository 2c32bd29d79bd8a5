"""What straight lines and parabolas could say of a tap, for `several --now --bound`: of a pad that knows the place,
and how long to look back.

Each chip's sample is the force with some noise; else all is as in several_now.py: eight free chips, frames that are
published late, and a controller that reads a thousand times a second.
"""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from fmfts.pad import Array
from fmfts_lab.bench.drills import RATE_HZ
from fmfts_lab.bench.now_pads import READ_EVERY_S

CHIPS, TAPS = 8, 40
TAP_S, BEFORE_S, AFTER_S = 0.05, 0.01, 0.015  # as motions.py has it
PERIOD_SHARE = 0.005  # deviation of a chip's own period
NOISE_N, ORDERS, WINDOWS_S = (0.005, 0.01, 0.02), (1, 2), (2e-3, 3e-3, 4e-3, 6e-3, 8e-3, 12e-3)


def run(options: Namespace, frame_s: float, early_s: float) -> None:
    """frame_s: from a frame to its publishing; early_s: from a sample that comes before it."""
    print("a tap of 50 ms, read at 1 kHz: rms N of the best straight line, and of the best parabola")
    for name, late_s, by_frames in (("frames alone", frame_s, True), ("samples as they come", early_s, False)):
        for noise_n in NOISE_N:
            best = [
                min((_rms(options.seed, noise_n, late_s, by_frames, order, window), window) for window in WINDOWS_S)
                for order in ORDERS
            ]
            told = ", ".join(f"{error:.3f} (of {window * 1e3:g} ms)" for error, window in best)
            print(f"{name}, {noise_n * 1e3:g} mN of noise in each sample: {told}", flush=True)


def _tap_n(time_s: Array) -> Array:
    inside = (time_s > 0.0) & (time_s < TAP_S)
    return np.where(inside, 0.5 * (1.0 - np.cos(2.0 * np.pi * time_s / TAP_S)), 0.0)


def _rms(seed: int, noise_n: float, late_s: float, by_frames: bool, order: int, window_s: float) -> float:
    random, period, off = np.random.default_rng((seed, 31)), 1.0 / RATE_HZ, []
    steps = np.arange(-12, 18)
    for _ in range(TAPS):
        periods = period * random.normal(1.0, PERIOD_SHARE, (CHIPS, 1))
        sampled = np.sort((random.uniform(0.0, period, (CHIPS, 1)) + periods * steps).ravel())
        read = _tap_n(sampled) + random.normal(0.0, noise_n, sampled.size)
        published = random.uniform(0.0, period) + period * steps + late_s
        for at in np.arange(-BEFORE_S, TAP_S + AFTER_S, READ_EVERY_S):
            newest = published[published <= at][-1] - late_s if by_frames else at - late_s
            seen = (sampled <= newest) & (sampled > newest - window_s)
            degree = min(order, max(int(seen.sum()) - 1, 0))
            if not seen.any():
                off.append(-float(_tap_n(np.array(at))))
                continue
            told = np.polynomial.polynomial.polyfit((sampled[seen] - at) * 1e3, read[seen], degree)[0]
            off.append(max(float(told), 0.0) - float(_tap_n(np.array(at))))
    return float(np.sqrt(np.mean(np.square(off))))
