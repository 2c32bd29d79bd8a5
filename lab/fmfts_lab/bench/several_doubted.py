"""One finger on a pad with four magnets: how often two are suspected, and what that adds to the deviations."""

from __future__ import annotations

from argparse import Namespace
from typing import Any
from unittest.mock import patch

import numpy as np

from fmfts.pad import Array, Tolerance
from fmfts.several.hidden import hidden_variance
from fmfts_calibrate.resultant import resultant_deviation
from fmfts_lab.bench.several_world import BUILT, BY_HAND, EXACT, any_press, estimator_of, read_once, worlds

FRAMES_OF_A_PAD = 100
WRONG = 5.0  # deviations
WIDER = 1.1


def run(options: Namespace) -> None:
    print(
        "| one finger | degraded | mean deviation of x, y, force, and without what may hide | frames with a deviation "
        "10 % wider | worst, deviations | wrong |\n| --- | --- | --- | --- | --- | --- |"
    )
    for name, tolerance in (("as drawn", EXACT), ("as built", BUILT), ("by hand, gains 5 %", BY_HAND)):
        print(_row(options, name, tolerance), flush=True)


def _row(options: Namespace, name: str, tolerance: Tolerance) -> str:
    degraded, frames, found = 0, 0, []
    added = np.zeros(3)

    def remembered(*arguments: Any) -> Array:
        added[:] = hidden_variance(*arguments)
        return added.copy()

    with patch("fmfts.several.estimator.hidden_variance", remembered):
        for one in worlds(options.one_finger, tolerance, options.seed + 1, FRAMES_OF_A_PAD):
            estimator = estimator_of(one)
            for _ in range(FRAMES_OF_A_PAD):
                press = any_press(one.random)
                added[:] = 0.0
                reading = read_once(one, one.pressed([press]), estimator)
                frames, degraded = frames + 1, degraded + (reading.health == "degraded")
                if reading.health != "ok" or reading.fit is None or len(reading.fit.fingers) != 1:
                    continue
                with_it = resultant_deviation(reading.fit)
                without = np.sqrt(np.maximum(np.square(with_it) - added, 0.0))
                off = np.abs(reading.fit.fingers[0] - np.array(press[:3])) / with_it
                found.append(np.concatenate([with_it, without, off]))
    each = np.array(found)
    wider = np.mean((each[:, :3] > WIDER * each[:, 3:6]).any(axis=1))
    pairs = each[:, :6].mean(axis=0).reshape(2, 3).T.tolist()
    means = ", ".join(f"{after:.4f} ({before:.4f})" for after, before in pairs)
    wrong = int((each[:, 6:] > WRONG).any(axis=1).sum())
    return f"| {name} | {degraded} of {frames} | {means} | {wider:.1%} | {each[:, 6:].max():.1f} | {wrong} |"
