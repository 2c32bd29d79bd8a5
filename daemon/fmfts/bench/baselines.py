"""What each baseline is worth at the contact: pads within their tolerances, exact fields, no noise in the press."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import numpy as np

from fmfts.ambient import Mounting
from fmfts.bench.recorded import KINDS, bare_and_rest, mountings, pressed_field
from fmfts.bench.workspace import standard_pad
from fmfts.contact import ContactModel
from fmfts.pad import Pad, Tolerance
from fmfts.pose import FREE_FIELD, as_drawn, solve
from fmfts.simulate.mounted import MountedPad

GRID_MM, FORCES_N = np.linspace(-12.0, 12.0, 7), (0.5, 1.0, 1.7)


def run(options: Namespace) -> None:
    drawing = standard_pad()
    contact = ContactModel.load("default", drawing)
    print(f"{options.pads} pads, contact MAE over the pad at {FORCES_N} N, x and y (mm) / force (N)\n")
    print("gains ±   " + " ".join(f"{name:>16}" for name in KINDS))
    for gain in (0.005, 0.05):
        errors = np.array([_errors(drawing, contact, gain, [options.seed, pad]) for pad in range(options.pads)])
        cells = [f"{place * 1e3:8.3f} /{force:6.4f}" for place, force in errors.mean(axis=0)]
        print(f"{gain:7.1%}   " + " ".join(f"{cell:>16}" for cell in cells))
    perfect = MountedPad.exact(drawing)
    _, own = bare_and_rest(perfect, drawing, Tolerance(1e-9, 1e-9, 1e-9, 0.0, 1e-9), np.random.default_rng(0))
    place, force = _contact_error(perfect, drawing, own, contact)
    print(f"\nof which the model's own, on a perfect pad: {place * 1e3:.3f} mm / {force:.4f} N")


def _errors(drawing: Pad, contact: ContactModel, gain: float, seed: list[int]) -> list[tuple[float, float]]:
    random = np.random.default_rng(seed)
    built = MountedPad.built(drawing, random)
    built = replace(built, gain=random.normal(1.0, gain, built.gain.shape))
    tolerance = Tolerance(1e-4, 1e-4, np.deg2rad(1.0), gain, 0.05)
    found = mountings(built, drawing, tolerance, random)
    return [_contact_error(built, drawing, found[kind], contact) for kind in KINDS]


def _contact_error(built: MountedPad, drawing: Pad, mounting: Mounting, contact: ContactModel) -> tuple[float, float]:
    """Mean absolute error of x and y (m) and of the force (N), over the pad."""
    mounted = mounting.mounted(drawing)
    place, force = [], []
    for x_mm, y_mm, force_n in ((x, y, f) for x in GRID_MM for y in GRID_MM for f in FORCES_N):
        field = mounting.magnet_field(pressed_field(built, x_mm * 1e-3, y_mm * 1e-3, force_n))
        estimate = solve(field, mounted, mounting.rest, free=FREE_FIELD)
        found = contact.estimate(*as_drawn(estimate, mounting.rest, drawing))
        place += [abs(found.x_m - x_mm * 1e-3), abs(found.y_m - y_mm * 1e-3)]
        force.append(abs(found.force_n - force_n))
    return float(np.mean(place)), float(np.mean(force))
