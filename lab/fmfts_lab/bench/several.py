"""Two fingers on a pad with four magnets: how often and how accurately they are reported, and how often one is reported
as two.
"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from fmfts.common.chi2 import quantile
from fmfts.pad import Array, Tolerance
from fmfts.pose.observable import FREE_FIELD
from fmfts.several.count import SECOND_GAIN, Counted, are_two, resultant
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Measured
from fmfts.several.odd_sensor import UNEXPLAINED
from fmfts_calibrate.resultant import deviation_of
from fmfts_lab.bench import (
    several_beside,
    several_calibrated,
    several_doubted,
    several_drills,
    several_free,
    several_growth,
    several_merged,
    several_now,
    several_poses,
    several_running,
    several_speed,
    several_whole,
)
from fmfts_lab.bench.several_world import (
    BUILT,
    BY_HAND,
    EXACT,
    WITHIN_MM,
    Press,
    World,
    any_press,
    read_once,
    two_places,
    worlds,
)

FRAMES_OF_A_PAD, ONE_FINGER_FRAMES_OF_A_PAD = 20, 500
WRONG = 5.0  # deviations
NOTHING = np.zeros(3)
VALUES = 24  # of a frame


@dataclass(slots=True)
class Tally:
    """The results of one row. errors (…, 3): of each finger, mm and N; deviations: as told."""

    frames: int = 0
    told: int = 0
    errors: list[Array] = field(default_factory=list)
    deviations: list[Array] = field(default_factory=list)

    def row(self, name: str) -> str:
        if not self.errors:
            return f"| {name} | {self.told / self.frames:.1%} of {self.frames} | | | | | |"
        error, deviation = np.concatenate(self.errors), np.concatenate(self.deviations)
        place = np.hypot(error[:, 0], error[:, 1])
        force = np.sqrt(np.mean(np.square(error[:, 2])))
        off = np.abs(error / deviation)
        return (
            f"| {name} | {self.told / self.frames:.1%} of {self.frames} | {np.median(place):.2f} "
            f"| {np.quantile(place, 0.9):.2f} | {force:.3f} | {off.max():.1f} | {(off > WRONG).any(axis=1).sum()} |"
        )


HEAD = (
    "| | told as two | place, median mm | p90 mm | force, rms N | worst, deviations | wrong |\n"
    "| --- | --- | --- | --- | --- | --- | --- |"
)


def run(options: Namespace) -> None:
    for asked, other in (
        (options.speed, several_speed),
        (options.growth, several_growth),
        (options.now, several_now),
        (options.running, several_running),
        (options.drills, several_drills),
        (options.merged, several_merged),
        (options.doubted, several_doubted),
        (options.beside, several_beside),
        (options.calibrated, several_calibrated),
        (options.whole, several_whole),
        (options.through_poses, several_poses),
        (options.free_poses, several_free),
    ):
        if asked:
            other.run(options)
            return
    if options.above:
        several_merged.run_above(options)
        return
    print(HEAD)
    for name, tolerance, forces, apart_mm in (
        ("as drawn, 1 + 1 N, 9 mm apart", EXACT, (1.0, 1.0), 9.0),
        ("as drawn, 1 + 1 N, 12 mm apart", EXACT, (1.0, 1.0), 12.0),
        ("as drawn, 2 + 0.2 N, 20 mm apart", EXACT, (2.0, 0.2), 20.0),
        ("as built, 1 + 1 N, 12 mm apart", BUILT, (1.0, 1.0), 12.0),
        ("as built, 1 + 1 N, 15 mm apart", BUILT, (1.0, 1.0), 15.0),
        ("as built, 2 + 0.2 N, 20 mm apart", BUILT, (2.0, 0.2), 20.0),
        ("by hand, gains 5 %, 1 + 1 N, 15 mm apart", BY_HAND, (1.0, 1.0), 15.0),
    ):
        print(_two(options, tolerance, forces, apart_mm).row(name), flush=True)
    for whole_n in (0.9, 1.8):
        _three(options, whole_n)
    print(
        "\n| one finger | told as two | largest gain of a second | one in a million | place, rms mm | force, rms N | "
        "beside one finger alone | worst, deviations | wrong |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    )
    for name, tolerance in (("as drawn", EXACT), ("as built", BUILT), ("by hand, gains 5 %", BY_HAND)):
        print(_one(options, name, tolerance), flush=True)


def _two(options: Namespace, tolerance: Tolerance, forces: tuple[float, float], apart_mm: float) -> Tally:
    tally = Tally()
    for one in worlds(options.frames, tolerance, options.seed, FRAMES_OF_A_PAD):
        for _ in range(FRAMES_OF_A_PAD):
            places = two_places(one.random, apart_mm)
            presses = [Press(x, y, force) for (x, y), force in zip(places.tolist(), forces, strict=True)]
            counted = _counted(one, one.measured(one.pressed(presses)))
            _add(tally, counted, np.array([press[:3] for press in presses]))
    return tally


def _three(options: Namespace, whole_n: float) -> None:
    """Three fingers, more than can be reported: the published results, and the errors of those published as good."""
    health, worst, wrong, frames = Counter[str](), 0.0, 0, 0
    for one in worlds(options.frames, BUILT, options.seed + 2, FRAMES_OF_A_PAD):
        for _ in range(FRAMES_OF_A_PAD):
            places = _three_apart(one.random)
            presses = [Press(x, y, whole_n / 3.0) for x, y in places.tolist()]
            reading = read_once(one, one.pressed(presses))
            frames += 1
            health["more" if reading.more else reading.health] += 1
            if reading.health == "ok" and reading.fit is not None:
                off = abs(reading.fit.fingers[:, 2].sum() - whole_n) / deviation_of(reading, reading.fit)[2]
                worst, wrong = max(worst, off), wrong + (off > WRONG)
    shares = ", ".join(f"{name} {count / frames:.1%}" for name, count in health.most_common())
    print(
        f"| three fingers, as built, {whole_n:g} N in all: {shares}; the force of those `ok` | | | | "
        f"| {worst:.1f} | {wrong} of {frames} |"
    )


def _three_apart(random: np.random.Generator) -> Array:
    """Three places (3, 2), 9 mm apart and more."""
    while True:
        places = random.uniform(-WITHIN_MM, WITHIN_MM, (3, 2))
        if min(np.hypot(*(places[i] - places[j])) for i, j in ((0, 1), (0, 2), (1, 2))) >= 9.0:
            return places


def _one(options: Namespace, name: str, tolerance: Tolerance) -> str:
    """One finger, by the counter alone: how many fingers it reports. several_whole.py has what is published of them."""
    gains, told, frames = [], 0, 0
    errors, alone, off = [], [], []
    for one in worlds(options.one_finger, tolerance, options.seed + 1, ONE_FINGER_FRAMES_OF_A_PAD):
        for _ in range(ONE_FINGER_FRAMES_OF_A_PAD):
            press = any_press(one.random)
            measured = one.measured(one.pressed([press]))
            counted, truth = _counted(one, measured), np.array(press[:3])
            frames, told = frames + 1, told + (len(counted.fit.fingers) == 2)
            fit = one.fitter.fit(truth[None], measured, NOTHING)
            alone.append(fit.fingers[0] - truth)
            if len(counted.fit.fingers):
                error = resultant(counted.fit.fingers) - truth
                errors.append(error)
                if len(counted.fit.fingers) == 1:
                    off.append(error / counted.fit.deviation[0])
            if frames <= options.gains:
                gains.append(gain_of_second(one, measured))
    error, reference, worst = np.array(errors), np.array(alone), np.abs(np.array(off))
    return (
        f"| {name} | {told} of {frames} | {max(gains):.1f} of {len(gains)} (limit {SECOND_GAIN:g}) "
        f"| {_one_in_a_million(np.array(gains)):.1f} | {_rms(error[:, :2]):.3f} | {_rms(error[:, 2:]):.4f} "
        f"| {_rms(error[:, :2]) / _rms(reference[:, :2]):.3f}, {_rms(error[:, 2:]) / _rms(reference[:, 2:]):.3f} "
        f"| {worst.max():.1f} | {(worst > WRONG).any(axis=1).sum()} |"
    )


def _one_in_a_million(gains: Array) -> float:
    """The gain that one frame in a million exceeds, if the tail continues as beyond its 99th percentile."""
    start = float(np.quantile(gains, 0.99))
    return start + float(np.mean(gains[gains >= start] - start)) * float(np.log(0.01 / 1e-6))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values).sum(axis=1))))


def gain_of_second(one: World, measured: Measured) -> float:
    """The decrease of χ² by the best second finger, tested as the counter does."""
    fitter = one.fitter
    nobody = np.zeros((0, FINGER))
    first = fitter.fit(fitter.best_single(fitter.whitener(nobody, measured, NOTHING), measured)[0], measured, NOTHING)
    root = fitter.whitener(first.fingers, measured, NOTHING)
    starts = fitter.best_seconds(root, first.fingers, measured) + fitter.best_pairs(root, measured)
    pairs = [one for one in (fitter.fit(pair, measured, NOTHING) for pair in starts) if are_two(one.fingers)]
    if not pairs:
        return 0.0
    best = min(pairs, key=lambda pair: pair.chi2)
    return max(first.chi2 - fitter.chi2_with(root, best.fingers, measured), 0.0)


def _counted(one: World, measured: Measured) -> Counted:
    """For one frame alone, without memory."""
    return one.counter().update(measured, NOTHING)


def _add(tally: Tally, counted: Counted, truth: Array) -> None:
    tally.frames += 1
    found, deviation = counted.fit.fingers, counted.fit.deviation
    limit = quantile(UNEXPLAINED, VALUES - FREE_FIELD - found.size)
    if len(found) != 2 or counted.fit.chi2 > limit:
        return
    tally.told += 1
    straight, crossed = found - truth, found[::-1] - truth
    if np.abs(crossed[:, :2]).sum() < np.abs(straight[:, :2]).sum():
        straight, deviation = crossed, deviation[::-1]
    tally.errors.append(straight)
    tally.deviations.append(deviation)
