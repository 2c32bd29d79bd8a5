"""Finds the force per count of the load cell from two known weights."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fmfts.cli.feed import Feed
from fmfts_collect.errors import AbsentError, RefusedError

GRAVITY_M_S2 = 9.80665  # standard; 0.3 % less at the equator, 0.2 % more at the poles
LISTEN_S = 2.0
FEWEST = 80  # readings: one second of an HX711 at 80 Hz
STEADY = 0.002  # largest spread of the counts, relative to the difference of both weights: then no weight swings
TURN_S = 0.002


def weigh(feed: Feed, weights_g: Sequence[float], ready: Callable[[str], None]) -> dict[str, Any]:
    """Measure two weights (g); returns facts with `newton_per_count`. ready: asks for a weight, and waits for it.

    Raises AbsentError where the board has no load cell, RefusedError where the weights do not give a scale.
    """
    if feed.counts is None:
        raise AbsentError("only a board behind a bridge has a load cell, and only while no fmfts-daemon runs on it")
    light_g, heavy_g = weights_g
    if light_g == heavy_g:
        raise RefusedError(f"two different weights are needed, not twice {light_g:g} g")
    means, spreads = [], []
    for weight_g in weights_g:
        ready(f"hang {weight_g:g} g on the load cell, let it come to rest, and press Enter")
        counts = _listen(feed)
        means.append(float(counts.mean()))
        spreads.append(float(counts.std()))
    difference = means[1] - means[0]
    if max(spreads) > STEADY * abs(difference):
        raise RefusedError(
            f"the counts swing by {max(spreads):.0f} and the weights are {abs(difference):.0f} counts apart: let them "
            "come to rest, take heavier ones, or check the load cell's wires"
        )
    newton_per_count = (heavy_g - light_g) * 1e-3 * GRAVITY_M_S2 / difference
    return {
        "newton_per_count": newton_per_count,
        "noise_n": float(np.mean(spreads)) * abs(newton_per_count),
        "counts_at_zero": means[0] - light_g * 1e-3 * GRAVITY_M_S2 / newton_per_count,
    }


def _listen(feed: Feed) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    assert feed.counts is not None
    feed.poll(time.monotonic_ns())
    feed.counts()  # discard the counts from before the weight
    counts: list[int] = []
    end_s = time.monotonic() + LISTEN_S
    while time.monotonic() < end_s:
        feed.poll(time.monotonic_ns())
        counts += [count for _, count in feed.counts()]
        time.sleep(TURN_S)
    if len(counts) < FEWEST:
        raise AbsentError(
            f"{len(counts)} readings of the load cell in {LISTEN_S:g} s, and an HX711 gives 80 a second: see the "
            "wiring in docs/firmware.md; its RATE pin must be high"
        )
    return np.array(counts, dtype=np.float64)
