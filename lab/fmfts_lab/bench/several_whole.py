"""What a pad with four magnets publishes of one finger, and of two that finite elements solved: the whole estimator.

Health, refusals, `more` and contacts are those of `FingersEstimator.read`, which the daemon calls for each frame.
"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fmfts.contact.array_model import ARRAY_PATH, ArrayModel
from fmfts.pad import Array, Tolerance
from fmfts.several.count import resultant
from fmfts.several.reading import FingersReading
from fmfts_calibrate.resultant import deviation_of, deviation_of_each
from fmfts_lab.bench.several_world import (
    BUILT,
    BY_HAND,
    EXACT,
    Press,
    World,
    any_press,
    estimator_of,
    read_once,
    world,
    worlds,
)
from fmfts_lab.finite_elements.array_model import DATA, read_presses
from fmfts_lab.finite_elements.array_pad import array_config

FRAMES_OF_A_PAD, FRAMES_OF_A_PAIR = 200, 10
WRONG = 5.0  # deviations
SI = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0])
LEVER_MM = 4.0  # a tilt counts like a movement of this size
HEAD = (
    "| what presses | `ok` | `degraded` | `more` | other | told as none, one, two, of these | wrong, `ok` | "
    "worst, deviations | place, median mm | p90 mm | force, rms N |\n" + "| --- " * 11 + "|"
)


class Found(NamedTuple):
    """A finger that one frame reports. pad: the seed that builds it, for `world`. frame: its number on that pad. error,
    deviation (3,): mm and N."""

    pad: int
    frame: int
    press: Press
    error: Array
    deviation: Array

    @property
    def off(self) -> float:
        return float(np.abs(self.error / self.deviation).max())

    def line(self) -> str:
        press, error, deviation = (
            " ".join(f"{value:.3f}" for value in each) for each in (self.press, self.error, self.deviation)
        )
        return f"  {self.off:.2f}: pad {self.pad}, frame {self.frame}, {press}; off by {error} of {deviation}"


@dataclass(slots=True)
class Whole:
    """The published results of the frames of one row. told: how many fingers each frame with contacts has. off: of the
    resultant and, if as many are told as there are, of each finger, in their deviations, of `ok` frames. errors (…, 3):
    of each of these fingers, mm and N. found: of one finger.
    """

    frames: int = 0
    said: Counter[str] = field(default_factory=Counter)
    told: Counter[int] = field(default_factory=Counter)
    off: list[float] = field(default_factory=list)
    errors: list[Array] = field(default_factory=list)
    found: list[Found] = field(default_factory=list)

    def add(self, reading: FingersReading, truth: Array) -> None:
        """truth (K, 3): the fingers that there are."""
        self.frames += 1
        self.said["more" if reading.more else reading.health] += 1
        fit = reading.fit
        if fit is None or reading.over_range:
            return
        self.told[len(fit.fingers)] += 1
        if reading.health != "ok" or not len(fit.fingers):
            return
        each = [(resultant(fit.fingers) - resultant(truth)) / deviation_of(reading, fit)]
        if len(fit.fingers) == len(truth):
            straight, crossed = fit.fingers - truth, fit.fingers - truth[::-1]
            nearer = np.abs(crossed[:, :2]).sum() < np.abs(straight[:, :2]).sum()
            errors = crossed if nearer else straight
            self.errors.append(errors)
            each.append((errors / deviation_of_each(reading, fit)).ravel())
        self.off.append(float(np.abs(np.concatenate(each)).max()))

    def line(self, name: str) -> str:
        other = self.frames - sum(self.said[one] for one in ("ok", "degraded", "more"))
        told = ", ".join(f"{self.told[count]:,}" for count in range(max([2, *self.told]) + 1))
        wrong, worst = sum(off > WRONG for off in self.off), max(self.off, default=0.0)
        error = np.concatenate(self.errors)
        place, force = np.hypot(error[:, 0], error[:, 1]), np.sqrt(np.mean(np.square(error[:, 2])))
        return (
            f"| {name} | {self.said['ok']:,} of {self.frames:,} | {self.said['degraded']} | {self.said['more']} "
            f"| {other} | {told} | {wrong} | {worst:.1f} | {np.median(place):.2f} | {np.quantile(place, 0.9):.2f} "
            f"| {force:.3f} |"
        )

    def worst(self, count: int) -> str:
        """How wide the deviations of one finger are, how often they hold, and the draws of the worst frames."""
        off = np.abs(np.array([one.error / one.deviation for one in self.found]))
        within = ", ".join(f"{share:.2%}" for share in np.mean(off < 2.0, axis=0))
        mean = ", ".join(f"{one:.4f}" for one in np.mean([one.deviation for one in self.found], axis=0))
        head = f"  x, y, force: within two deviations {within}; these are {mean} on average"
        worst = sorted(self.found, key=lambda one: -one.off)[:count]
        return "\n".join([head, *(one.line() for one in worst)])


def run(options: Namespace) -> None:
    print(HEAD)
    for name, least_n, most_n in (
        ("the weaker below 0.3 N", 0.0, 0.3),
        ("both 0.3 N and more", 0.3, 2.0),
        ("all", 0.0, 2.0),
    ):
        print(
            solved_pairs(world(options.seed, EXACT), least_n, most_n).line(f"pairs of finite elements, {name}"),
            flush=True,
        )
    for name, tolerance in (("as drawn", EXACT), ("as built", BUILT), ("by hand, gains 5 %", BY_HAND)):
        whole = one_finger(options, tolerance)
        print(whole.line(f"one finger, {name}"), flush=True)
        if options.worst:
            print(whole.worst(options.worst), flush=True)
    print("\n" + table_error())


def table_error() -> str:
    """The distance of the table, and of the sum of two of its presses, from presses that finite elements solved."""
    response = ArrayModel.load(ARRAY_PATH, array_config().pad()).response
    presses, changes = read_presses(DATA / "test-one.csv")
    wide = np.tile([1.0, 1.0, 1.0, LEVER_MM, LEVER_MM], changes.shape[1] // len(SI))
    told = np.array([response.pressed(*press[0, :3].tolist()).change for press in presses])
    share = np.abs((told - changes) * wide).max(axis=1) / np.abs(changes * wide).max(axis=1)
    pairs, changes = read_presses(DATA / "test-pairs.csv", 2)
    told = np.array([sum(response.pressed(*press[:3].tolist()).change for press in pair) for pair in pairs])
    missed_mm = np.linalg.norm((told - changes).reshape(len(pairs), -1, len(SI))[:, :, :3], axis=2).max(axis=1)
    whole_n = pairs[:, :, 2].sum(axis=1)
    up_to = ", ".join(f"{missed_mm[whole_n < most].max() * 1e3:.0f} µm up to {most:g} N" for most in (1.0, 2.0))
    return (
        f"table: {len(presses)} solved presses agree to {share.max():.2%} of the largest movement, "
        f"{np.median(share):.2%} at the median; the sum of two misses a magnet's place by {up_to} in all"
    )


def solved_pairs(one: World, least_n: float, most_n: float) -> Whole:
    """Pairs that finite elements solved at once, 0.4 to 2 N in all, each with the noise of several frames: how fingers
    add up is not the table's.

    least_n, most_n: of the weaker finger.
    """
    whole, estimator = Whole(), estimator_of(one)
    for pair, change in zip(*read_presses(DATA / "test-pairs.csv", 2), strict=True):
        if not least_n <= pair[:, 2].min() < most_n:
            continue
        for _ in range(FRAMES_OF_A_PAIR):
            whole.add(read_once(one, (change.reshape(-1, len(SI)) * SI).ravel(), estimator), pair[:, :3])
    return whole


def one_finger(options: Namespace, tolerance: Tolerance) -> Whole:
    whole = Whole()
    for number, one in enumerate(worlds(options.one_finger, tolerance, options.seed + 4, FRAMES_OF_A_PAD)):
        estimator = estimator_of(one)
        for frame in range(FRAMES_OF_A_PAD):
            press: Press = any_press(one.random)
            reading = read_once(one, one.pressed([press]), estimator)
            whole.add(reading, np.array([press[:3]]))
            fit = reading.fit
            if reading.health == "ok" and fit is not None and len(fit.fingers) == 1:
                error, deviation = fit.fingers[0] - press[:3], deviation_of(reading, fit)
                whole.found.append(Found(1000 * (options.seed + 4) + number, frame, press, error, deviation))
    return whole
