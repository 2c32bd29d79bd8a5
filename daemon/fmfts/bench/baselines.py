"""What each baseline is worth at the contact: pads within their tolerances, exact fields, no noise in the press."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import numpy as np

from fmfts.ambient import Baseline, Means, Mounting, Recording, make_bare, make_refined, make_rest, make_turn
from fmfts.bench.workspace import Array, standard_pad
from fmfts.contact import ContactModel
from fmfts.pad import Pad, Tolerance, rotation_from_vector
from fmfts.pose import FREE_FIELD, as_drawn, solve
from fmfts.simulate.mounted import MountedPad

NOISE_T, FRAMES, MEAN_OF = 2e-7, 660, 11
ORIENTATIONS, UNLABELLED = 100, 30
GRID_MM, FORCES_N = np.linspace(-12.0, 12.0, 7), (0.5, 1.0, 1.7)
COLUMNS = ("rest only", "bare + rest", "+ turn", "+ refine", "+ turn + refine")


def run(options: Namespace) -> None:
    drawing = standard_pad()
    contact = ContactModel.load("default", drawing)
    print(f"{options.pads} pads, contact MAE over the pad at {FORCES_N} N, x and y (mm) / force (N)\n")
    print("gains ±   " + " ".join(f"{name:>16}" for name in COLUMNS))
    for gain in (0.005, 0.05):
        errors = np.array([_errors(drawing, contact, gain, [options.seed, pad]) for pad in range(options.pads)])
        cells = [f"{place * 1e3:8.3f} /{force:6.4f}" for place, force in errors.mean(axis=0)]
        print(f"{gain:7.1%}   " + " ".join(f"{cell:>16}" for cell in cells))
    perfect = MountedPad.exact(drawing)
    _, own = _recorded(perfect, drawing, Tolerance(1e-9, 1e-9, 1e-9, 0.0, 1e-9), np.random.default_rng(0))
    place, force = _contact_error(perfect, drawing, own, contact)
    print(f"\nof which the model's own, on a perfect pad: {place * 1e3:.3f} mm / {force:.4f} N")


def _errors(drawing: Pad, contact: ContactModel, gain: float, seed: list[int]) -> list[tuple[float, float]]:
    random = np.random.default_rng(seed)
    built = MountedPad.built(drawing, random)
    built = replace(built, gain=random.normal(1.0, gain, built.gain.shape))
    tolerance = Tolerance(1e-4, 1e-4, np.deg2rad(1.0), gain, 0.05)
    _, alone = _recorded(built, drawing, tolerance, random, with_bare=False)
    both, mounting = _recorded(built, drawing, tolerance, random)
    turn, presses = _turned(built, random), _pressed(built, random)
    turned, after_turn = make_turn(drawing, turn, both)
    mountings = (
        alone,
        mounting,
        after_turn,
        make_refined(drawing, presses, both)[1],
        make_refined(drawing, presses, turned)[1],
    )
    return [_contact_error(built, drawing, one, contact) for one in mountings]


def _recorded(
    built: MountedPad, drawing: Pad, tolerance: Tolerance, random: np.random.Generator, with_bare: bool = True
) -> tuple[Baseline, Mounting]:
    def recording(field: Array) -> Recording:
        mean = field + random.normal(0.0, NOISE_T / np.sqrt(FRAMES), field.shape)
        return Recording(mean, np.full(field.shape, NOISE_T), np.full(len(field), FRAMES), 3, 25.0, 3.0)

    count = len(drawing.sensors)
    bare = recording(built.sensed(np.tile(built.ambient_t, (count, 1))))
    before = make_bare(drawing, tolerance, bare) if with_bare else None
    return make_rest(drawing, tolerance, recording(_field(built, 0.0, 0.0, 0.0)), before)


def _field(built: MountedPad, x_m: float, y_m: float, force_n: float, ambient_t: Array | None = None) -> Array:
    count = len(built.pad.sensors)
    ambient = built.ambient_t if ambient_t is None else ambient_t
    x, y, force = (np.full(count, value) for value in (x_m, y_m, force_n))
    return built.sensed(built.magnet_field(x, y, force) + ambient)


def _turned(built: MountedPad, random: np.random.Generator) -> Means:
    """Orientations at random; the field's strength differs by half a percent from one to the other."""
    attitudes = [rotation_from_vector(random.normal(0.0, 2.0, 3)) for _ in range(ORIENTATIONS)]
    strength, drawn = random.normal(0.0, 0.005, (3, 3)), []
    for attitude in attitudes:
        earth = attitude @ built.ambient_t
        unit = earth / np.linalg.norm(earth)
        drawn.append(_field(built, 0.0, 0.0, 0.0, earth * (1.0 + unit @ strength @ unit)))
    return _means(np.array(drawn), random)


def _pressed(built: MountedPad, random: np.random.Generator) -> Means:
    place, force = random.uniform(-12e-3, 12e-3, (UNLABELLED, 2)), random.uniform(0.3, 2.0, UNLABELLED)
    return _means(np.array([_field(built, x, y, f) for (x, y), f in zip(place, force, strict=True)]), random)


def _means(fields: Array, random: np.random.Generator) -> Means:
    noisy: Array = fields + random.normal(0.0, NOISE_T, fields.shape) / np.sqrt(MEAN_OF)
    times = np.linspace(0.0, 20.0, len(fields))
    return Means(noisy, np.zeros(len(fields)), times, np.full(fields.shape[1:], NOISE_T))


def _contact_error(built: MountedPad, drawing: Pad, mounting: Mounting, contact: ContactModel) -> tuple[float, float]:
    """Mean absolute error of x and y (m) and of the force (N), over the pad."""
    mounted = mounting.mounted(drawing)
    place, force = [], []
    for x_mm, y_mm, force_n in ((x, y, f) for x in GRID_MM for y in GRID_MM for f in FORCES_N):
        field = mounting.magnet_field(_field(built, x_mm * 1e-3, y_mm * 1e-3, force_n))
        estimate = solve(field, mounted, mounting.rest, free=FREE_FIELD)
        found = contact.estimate(*as_drawn(estimate, mounting.rest, drawing))
        place += [abs(found.x_m - x_mm * 1e-3), abs(found.y_m - y_mm * 1e-3)]
        force.append(abs(found.force_n - force_n))
    return float(np.mean(place)), float(np.mean(force))
