"""Force in three directions over the whole pad: errors beside the bound, honesty by zone, and its cost without shear.

Single frames of the perfect standard pad at 2 mG. A frame counts if the model without shear tells a force that is
certain, as for a contact in a message.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from time import perf_counter_ns

import numpy as np
from numpy.typing import NDArray

from fmfts.contact import ContactModel
from fmfts.contact.tolerances import FINGER_M, PROBE_M, StructureTolerance
from fmfts.pad import Array
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.bounds import bound_of
from fmfts_calibrate.tracked import FrameSolver, Tracked, upright
from fmfts_lab.bench.contact_answers import estimates
from fmfts_lab.bench.workspace import standard_pad
from fmfts_lab.calibration.simulated import magnet_fields, rest_field_of
from fmfts_lab.calibration.solved_set import labelled
from fmfts_simulation.finger_shape import FingerShape
from fmfts_simulation.mechanics import Mechanics
from fmfts_simulation.solved_table import SHEARED_PATH, read_solved, standard_mechanics

LARGEST_FRICTION, EDGE_MM = 0.8, 14.0
FORCES_N = (0.28, 1.98)
ZONES_MM = ((0.0, 4.0), (4.0, 8.0), (8.0, 11.0), (11.0, 20.0))
FRAMES_AT_ONCE = 20_000
CERTAIN, HONEST, WRONG = 2.0, 2.0, 5.0  # deviations
TURNS = 5  # of each model, of which the fastest counts
TENTH_S, MEANS = 22, 20  # frames of 0.1 s at 220 Hz; means of each press
MM = np.array([1e3, 1e3, 1.0, 1.0, 1.0])
SOLVED = {6.0: "test_friction", 3.0: "test_friction_3"}  # by the probe's width in mm
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Judged:
    """Contacts: press, error and deviation (K, 3 or 5) in mm and N. told: share of the frames that are contacts."""

    press: Array
    error: Array
    deviation: Array
    contact: Mask

    @classmethod
    def of(cls, model: ContactModel, press: Array, tracked: Tracked) -> Judged:
        said = estimates(model, tracked)
        unit = MM[: len(said[0].values)]
        found, deviation = (np.array([getattr(one, name) * unit for one in said]) for name in ("values", "deviations"))
        plain = estimates(model_of("default", 0.0), tracked)
        certain = np.array([one.force_n > CERTAIN * one.force_sd_n for one in plain])
        contact = np.array([not one.over_range for one in said]) & certain
        return cls(press, found - press[:, : len(unit)], deviation, contact)

    def zones(self) -> Iterator[tuple[str, Mask]]:
        radius = np.hypot(*self.press[:, :2].T)
        for low, high in ZONES_MM:
            members = (radius >= low) & (radius < high) & self.contact
            if members.any():
                yield (f"{low:g} to {high:g} mm" if high < EDGE_MM else f"{low:g} mm to the rim"), members

    def rms(self, members: Mask) -> Array:
        return np.asarray(np.sqrt(np.mean(self.error[members] ** 2, axis=0)))

    def honesty(self, members: Mask) -> tuple[Array, int]:
        """Share of each number within two deviations, and how many frames are off by more than five."""
        in_sd = np.abs(self.error[members]) / self.deviation[members]
        return np.mean(in_sd < HONEST, axis=0), int((in_sd > WRONG).any(axis=1).sum())


@dataclass(frozen=True, slots=True)
class World:
    """The standard pad, and the finite elements' table."""

    solver: FrameSolver
    mechanics: Mechanics

    @classmethod
    def standard(cls) -> World:
        pad = standard_pad()
        return cls(FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T), standard_mechanics())

    def drawn(self, count: int, friction: float, random: np.random.Generator) -> Array:
        """(K, 5) presses all over the pad, with shear even over a cone whose friction is even up to `friction`."""
        place_mm, force_n = random.uniform(-EDGE_MM, EDGE_MM, (count, 2)), random.uniform(*FORCES_N, count)
        shear_n = random.uniform(0.0, friction, count) * force_n * np.sqrt(random.uniform(0.0, 1.0, count))
        angle = random.uniform(0.0, 2.0 * np.pi, count)
        return np.column_stack([place_mm, force_n, shear_n * np.cos(angle), shear_n * np.sin(angle)])

    def tracked(self, press: Array, width_m: Array, random: np.random.Generator) -> Tracked:
        """Noisy frames of presses by discs of such widths (K,)."""
        moment_mm2 = (width_m * 1e3) ** 2 / 16.0
        loads = (*(press[:, :2] * 1e-3).T, *press[:, 2:].T)
        moved = FingerShape((moment_mm2, moment_mm2)).response(self.mechanics, loads)
        pad = self.solver.pad
        return self.noisy(magnet_fields(pad, moved[:, :3], upright(moved)[:, 3:6]), random)

    def noisy(self, field_t: Array, random: np.random.Generator) -> Tracked:
        return self.solver.solved(field_t + random.normal(0.0, NOISE_T, field_t.shape))


def model_of(name: str, friction: float, finger_m: tuple[float, float] = (PROBE_M, PROBE_M)) -> ContactModel:
    return ContactModel.load(name, standard_pad(), friction=friction, tolerance=StructureTolerance(finger_m=finger_m))


def run(options: Namespace) -> None:
    random = np.random.default_rng(options.seed)
    parts: dict[str, Callable[[], None]] = {
        "solved": lambda: solved(random),
        "frames": lambda: frames(options.frames, random),
        "plain": lambda: plain(options.frames, options.seed),
        "speed": lambda: speed(random),
    }
    for name, part in parts.items():
        if options.part in (None, name):
            part()


def numbers(values: Array, digits: int = 3) -> str:
    return "".join(f"{value:8.{digits}f}" for value in values)


def solved(random: np.random.Generator) -> None:
    """Presses that finite elements solved one by one, by probes of 3 and 6 mm, with friction up to 0.8."""
    world, repeats = World.standard(), TENTH_S * MEANS
    model = model_of("shear", LARGEST_FRICTION, FINGER_M)
    assert model.response is not None
    print("solved presses: rms of x, y (mm), force, shear x, y (N); the three forces over the bound of a frame; rms of")
    print("their means of 0.1 s around the mean of all; and of that mean, which is what the model itself is off")
    for width_mm, name in SOLVED.items():
        rows = labelled(read_solved(SHEARED_PATH.with_name(f"{name}.csv")), world.solver.pad)
        field_t = rows[:, 5:].reshape(len(rows), -1, 3) * 1e-6
        many = world.noisy(np.repeat(field_t, repeats, axis=0), random)
        judged = Judged.of(model, np.repeat(rows[:, :5], repeats, axis=0), many)
        covariance = many.covariance[::repeats]
        bound = bound_of(model.response.change_and_slope(rows[:, :5])[1], covariance)
        each = judged.error.reshape(len(rows), MEANS, TENTH_S, 5)[..., 2:]
        mean = each.mean(axis=(1, 2))
        around = each.mean(axis=2) - mean[:, None]
        print(f"by {width_mm:g} mm, {len(rows)} presses")
        for zone, members in judged.zones():
            here = np.unique(np.flatnonzero(members) // repeats)
            over = judged.rms(members)[2:] / np.sqrt(np.mean(bound[here, 2:] ** 2, axis=0))
            honest, wrong = judged.honesty(members)
            noise, own = (np.sqrt(np.mean(np.reshape(v[here], (-1, 3)) ** 2, axis=0)) for v in (around, mean))
            print(
                f"  {zone:16} {len(here):3d}: {numbers(judged.rms(members))} | over bound {numbers(over, 2)} | "
                f"0.1 s {numbers(noise)} | own {numbers(own)} | within 2 sd {honest.min():.1%} to {honest.max():.1%}, "
                f"{wrong} of {members.sum()} beyond 5"
            )


def frames(count: int, random: np.random.Generator) -> None:
    """Frames of the table's presses, each of another finger of 3 to 12 mm and another friction up to 0.8."""
    world, model = World.standard(), model_of("shear", LARGEST_FRICTION, FINGER_M)
    print(f"{count} frames, friction up to {LARGEST_FRICTION:g}, probes of 3 to 12 mm: rms; within 2 sd; beyond 5 sd")
    report([_judged(world, model, batch, LARGEST_FRICTION, random) for batch in _batches(count)])


def plain(count: int, seed: int) -> None:
    """The same presses by both models, by the probe and by fingers of other widths, without shear and with friction
    up to 0.3."""
    world = World.standard()
    for probe, friction, name in product((True, False), (0.0, 0.3), ("default", "shear")):
        model, random = model_of(name, 0.3, (PROBE_M, PROBE_M) if probe else FINGER_M), np.random.default_rng(seed)
        finger = f"{'the probe' if probe else 'fingers of 3 to 12 mm'}, its friction up to {friction:g}"
        print(f'{finger}; model = "{name}", friction = 0.3: rms; within 2 sd; beyond 5 sd')
        report([_judged(world, model, batch, friction, random, probe) for batch in _batches(count // 10)])


def report(all_judged: list[Judged]) -> None:
    names = ("press", "error", "deviation", "contact")
    whole = Judged(*(np.concatenate([getattr(one, name) for one in all_judged]) for name in names))
    for zone, members in whole.zones():
        honest, wrong = whole.honesty(members)
        typical = np.sqrt(np.mean(whole.deviation[members] ** 2, axis=0))
        print(
            f"  {zone:16} {numbers(whole.rms(members))} | deviations {numbers(typical)} | {numbers(honest)} | "
            f"{wrong} of {members.sum()}"
        )
    print(f"  contacts: {whole.contact.mean():.1%} of the frames", flush=True)


def _batches(count: int) -> list[int]:
    return [min(FRAMES_AT_ONCE, count - done) for done in range(0, count, FRAMES_AT_ONCE)]


def _judged(
    world: World, model: ContactModel, count: int, friction: float, random: np.random.Generator, probe: bool = False
) -> Judged:
    press = world.drawn(count, friction, random)
    width_m = np.full(count, PROBE_M) if probe else random.uniform(*FINGER_M, count)
    return Judged.of(model, press, world.tracked(press, width_m, random))


def speed(random: np.random.Generator) -> None:
    """Processor time of an estimate, with the same call's cost in Python, in turns; and of the slowest frame, with the
    largest shear and a finger of a known width too, of which each round of corrections solves the press again."""
    world = World.standard()
    for friction in (0.3, LARGEST_FRICTION):
        press = world.drawn(1000, friction, random)
        tracked = world.tracked(press, np.full(len(press), PROBE_M), random)
        models = {name: model_of(name, friction, FINGER_M) for name in ("default", "shear")}
        models["shear, a known finger"] = model_of("shear", friction, (FINGER_M[1], FINGER_M[1]))
        each = [tracked.some(np.arange(len(press)) == number) for number in range(len(press))]
        taken_us = {name: np.full((TURNS, len(press)), np.inf) for name in models}
        for turn in range(TURNS):
            for name, model in models.items():
                for number, one in enumerate(each):
                    begun = perf_counter_ns()
                    estimates(model, one)
                    taken_us[name][turn, number] = (perf_counter_ns() - begun) * 1e-3
        least_us = {name: us.min(axis=0) for name, us in taken_us.items()}
        told = [f"{name} {np.median(us):.0f}, slowest {us.max():.0f}" for name, us in least_us.items()]
        print(f"friction up to {friction:g}, an estimate, median (µs): {'; '.join(told)}")
