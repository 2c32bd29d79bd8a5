"""Measures the time of a solve, and of other solvers in the same run."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

from fmfts.pad import SensorArray
from fmfts.pose import STOP_CHI2, Batch, Part, Problem, State
from fmfts.pose.kernel import ITERATIONS, STATUS, columns_of, predict
from fmfts.pose.problem import MAX_ITERATIONS, VALUE, magnet_rows
from fmfts.pose.state import Neighbour
from fmfts_lab.bench.other_kernel import loaded, ratio
from fmfts_lab.bench.rivals import moment_vector_solvers
from fmfts_lab.bench.speed_chart import draw_growth
from fmfts_lab.bench.workspace import batch_of, displaced, in_workspace, readings, standard_pad

PADS = 256
REPEATS = 40
# From one frame to the next at 220 Hz: a press to 1 N within 0.2 s moves the magnet half a millimetre and 0.1 rad.
MOVED_M, MOVED_RAD = 11e-6, 2.3e-3
# The same for a tap of 50 ms.
TAPPED_M, TAPPED_RAD = 45e-6, 9e-3
# Unknowns, octupole, prior.
MODELS = [(5, False, False), (6, False, False), (8, False, False), (6, True, False), (8, True, False), (8, True, True)]


def run(options: Namespace) -> None:
    random = np.random.default_rng(options.seed)
    if options.beside is not None:
        _beside_another(options.beside, random)
        return
    print(f"warm start, covariance included; processor time per solve in a batch of {PADS} pads, median of {REPEATS}\n")
    print(
        f"kernel                         |    µs | iterations p50 p99.9 | µs: {PADS} pads in one call, "
        f"{PADS} × a solve alone, {PADS} calls"
    )
    six = 0.0
    for unknowns, octupole, prior in MODELS:
        batch = _warm(unknowns, octupole, prior, random)
        each = _timed(batch)
        six = each if (unknowns, octupole) == (6, False) else six
        label = _label(unknowns, octupole, prior)
        iterations = _iterations(unknowns, octupole, prior, random)
        called, empty = _call(batch, 1), _call(batch, 0)
        totals = [PADS * value for value in (each, called - empty, called)]
        print(f"{label:30} | {each:5.2f} | {iterations} | {totals[0]:20.0f} {totals[1]:16.0f} {totals[2]:14.0f}")
    tapped = _timed(_warm(6, False, False, random, metres=TAPPED_M, radians=TAPPED_RAD))
    print(f"{'6 unknowns, within a tap':30} | {tapped:5.2f} |")
    _beside(six, random)
    sensors = {count: _many_sensors(count, random) for count in (4, 8, 16, 32, 64)}
    magnets = {count: _many_magnets(count, random) for count in (1, 2, 3, 4)}
    print("\neight unknowns        | µs")
    for count, each in sensors.items():
        print(f"{count:3d} sensors           | {each:5.1f}")
    for count, each in magnets.items():
        print(f"{count:3d} magnets, 4 sensors | {each:5.1f}")
    if options.chart is not None:
        draw_growth(sensors, magnets, options.chart)


def _beside_another(path: Path, random: np.random.Generator) -> None:
    other = loaded(path)
    print(f"time of this kernel over that of {path}, turns alternating\n")
    print("kernel                         | fastest | median")
    for unknowns, octupole, prior in MODELS:
        fastest, median = ratio(_warm(unknowns, octupole, prior, random), other)
        print(f"{_label(unknowns, octupole, prior):30} | {fastest:7.3f} | {median:6.3f}")


def _label(unknowns: int, octupole: bool, prior: bool) -> str:
    return f"{unknowns} unknowns{', octupole' if octupole else ''}{', prior' if prior else ''}"


def _warm(
    unknowns: int,
    octupole: bool,
    prior: bool,
    random: np.random.Generator,
    pads: int = PADS,
    metres: float = MOVED_M,
    radians: float = MOVED_RAD,
) -> Batch:
    pad, poses = standard_pad(), in_workspace(pads, random)
    batch = batch_of(readings(poses, pad, random), pad, unknowns, octupole, displaced(poses, metres, radians, random))
    if not prior:
        return batch
    # Solve the previous frame; its covariance, enlarged by the motion, is the prior.
    batch.solve(STOP_CHI2, MAX_ITERATIONS)
    columns = np.arange(columns_of(1))
    grown = batch.covariance.copy()
    grown[:, columns, columns] += np.array([metres] * 3 + [radians] * 2 + [1e-3] + [1e-8] * 3 + [1e-6] * 5) ** 2
    parts = np.where(batch.parts == Part.FREE, Part.PRIOR, Part.FIXED).astype(np.uint8)
    return replace(batch, parts=parts, prior_mean=batch.start, prior_covariance=grown)


def _timed(batch: Batch) -> float:
    """Microseconds per solve."""
    taken = []
    for _ in range(REPEATS):
        begun = process_time()
        batch.solve(STOP_CHI2, MAX_ITERATIONS)
        taken.append(process_time() - begun)
    assert (batch.summary[:, STATUS] == 0).all()
    return float(np.median(taken)) / len(batch.summary) * 1e6


def _call(batch: Batch, count: int) -> float:
    """Microseconds of a call for `count` pads of the batch. A call for no pad shows the cost of the call itself."""
    names = [field.name for field in fields(batch) if getattr(batch, field.name) is not None]
    singles = [
        replace(batch, **{name: getattr(batch, name)[pad : pad + count] for name in names})
        for pad in range(len(batch.summary))
    ]

    def each() -> None:
        for single in singles:
            single.solve(STOP_CHI2, MAX_ITERATIONS)

    return _median(each) / len(singles)


def _iterations(unknowns: int, octupole: bool, prior: bool, random: np.random.Generator) -> str:
    batch = _warm(unknowns, octupole, prior, random, pads=20000)
    batch.solve(STOP_CHI2, MAX_ITERATIONS)
    # + 1 for the last step, which does not evaluate the model.
    median, most = np.percentile(batch.summary[:, ITERATIONS] + 1, [50, 99.9])
    return f"{median:14.0f} {most:5.0f}"


def _beside(kernel_us: float, random: np.random.Generator) -> None:
    """Solve the same six unknowns, from the same fields and starts, by other solvers."""
    batch, pad = _warm(6, False, False, random, pads=32), standard_pad()
    problems = [
        Problem(rows, magnet_rows(pad.magnet, octupole=False), parts, State.from_vector(start))
        for rows, parts, start in zip(batch.measurements, batch.parts, batch.start, strict=True)
    ]
    print("\nsix unknowns by                             |      µs | times the kernel's")
    for name, solver in moment_vector_solvers(pad).items():
        each = _median(partial(_all, solver, problems)) / len(problems)
        print(f"{name:43} | {each:7.1f} | {each / kernel_us:5.0f}")


def _all(solver: Callable[[Problem], object], problems: list[Problem]) -> None:
    for problem in problems:
        solver(problem)


def _many_sensors(count: int, random: np.random.Generator) -> float:
    pad, poses = standard_pad(), in_workspace(64, random)
    side = random.uniform([-10e-3, -10e-3, -1e-3], [10e-3, 10e-3, 0.0], (count, 3))
    side[:4] = pad.sensors.position_m
    wide = replace(pad, sensors=SensorArray.aligned(side))
    return _timed(batch_of(readings(poses, wide, random), wide, 8, False, displaced(poses, MOVED_M, MOVED_RAD, random)))


def _many_magnets(count: int, random: np.random.Generator) -> float:
    """Time of a solve with neighbours 60 mm away, known to the accuracy of one frame of their own pads."""
    pad, poses = standard_pad(), in_workspace(64, random)
    rows, start = readings(poses, pad, random), displaced(poses, MOVED_M, MOVED_RAD, random)
    places = np.array([[60e-3, 0.0, 12e-3], [-60e-3, 0.0, 12e-3], [0.0, 60e-3, 12e-3]])[: count - 1]
    others = tuple(Neighbour(place, np.array([0.0, 0.0, 1.0]), 0.0) for place in places)
    whole = replace(State.from_vector(start[0]), neighbours=others).vector()
    magnets = magnet_rows(*([pad.magnet] * count))
    alone, _ = predict(rows[0], magnets[:1], State.from_vector(start[0]))
    together, _ = predict(rows[0], magnets, State.from_vector(whole))
    rows[:, :, VALUE] += together - alone
    starts = np.concatenate([start, np.tile(whole[15:], (len(start), 1))], axis=1)
    columns = columns_of(count)
    parts = np.full(columns, Part.PRIOR, dtype=np.uint8)
    parts[[0, 1, 2, 3, 4, 6, 7, 8]] = Part.FREE
    parts[[5, *range(9, 14)]] = Part.FIXED
    covariance = np.diag(np.r_[np.ones(14), np.tile([1e-5, 1e-5, 1e-5, 2e-3, 2e-3, 5e-3], count - 1)] ** 2)
    if count == 1:
        return _timed(Batch.of(rows, magnets, parts, starts))
    return _timed(Batch.of(rows, magnets, parts, starts, starts, covariance))


def _median(action: Callable[[], object]) -> float:
    """Median time of `action` in microseconds."""
    taken = []
    for _ in range(9):
        begun = process_time()
        action()
        taken.append(process_time() - begun)
    return float(np.median(taken)) * 1e6
