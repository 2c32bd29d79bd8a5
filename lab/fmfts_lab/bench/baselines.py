"""Contact errors after each kind of baseline, for pads within their tolerances, with exact fields and no noise."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass, replace

import numpy as np

from fmfts.baseline import Mounting
from fmfts.contact import ContactEstimate, ContactModel
from fmfts.pad import Pad, Tolerance
from fmfts.pipeline.drawn import in_nominal_frame
from fmfts.pose import FREE_FIELD, solve
from fmfts_lab.bench.recorded import KINDS, bare_and_rest, mountings, pressed_field, selftested
from fmfts_lab.bench.workspace import standard_pad
from fmfts_simulation.mounted import CROSS_AXIS, MountedPad, with_chips_turned

GRID_MM, FORCES_N = np.linspace(-12.0, 12.0, 7), (0.5, 1.0, 1.7)
# Where the pad measures shear, it is tested with a quarter of the force, in four directions.
FRICTION = 0.4  # shear that the model assumes
SHEARED_MM, SHEARED_N, SHEARS_N = np.linspace(-6.0, 6.0, 5), 1.7, ((0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4))


@dataclass(frozen=True, slots=True)
class Case:
    """Deviations of the gains and of the chips' rotations, and whether a self-test measured the gains."""

    gain: float
    rotation_deg: float
    selftest: bool = False


CASES = [
    Case(gain, rotation_deg, selftest)
    for rotation_deg in (0.0, 1.5)
    for gain, selftest in ((0.005, False), (0.05, False), (0.05, True))
]


def run(options: Namespace) -> None:
    drawing = standard_pad()
    contact = ContactModel.load("default", drawing)
    sheared = ContactModel.load("shear", drawing, friction=FRICTION)
    print(
        f"{options.pads} pads, contact MAE over the pad at {FORCES_N} N, x and y (mm) / force (N) / shear (N, ±6 mm)\n"
    )
    print("gains ±, self-test, chips turned by   " + " ".join(f"{name:>22}" for name in KINDS))
    for case in CASES:
        seeds = ([options.seed, pad] for pad in range(options.pads))
        errors = np.array([_errors(drawing, contact, sheared, case, seed) for seed in seeds])
        cells = [f"{place * 1e3:8.3f} /{force:6.4f} /{shear:5.2f}" for place, force, shear in errors.mean(axis=0)]
        known = f"{case.gain:7.1%} {'yes' if case.selftest else 'no':>10} {case.rotation_deg:14.1f}°   "
        print(known + " ".join(f"{cell:>22}" for cell in cells), flush=True)
    perfect = MountedPad.exact(drawing)
    _, own = bare_and_rest(perfect, drawing, Tolerance(1e-9, 1e-9, 1e-9, 0.0, 1e-9), np.random.default_rng(0))
    place, force = _contact_error(perfect, drawing, own, contact)
    print(f"\nof which the model's own, on a perfect pad: {place * 1e3:.3f} mm / {force:.4f} N")


def _errors(
    drawing: Pad, contact: ContactModel, sheared: ContactModel, case: Case, seed: list[int]
) -> list[tuple[float, float, float]]:
    random = np.random.default_rng(seed)
    rotation_rad = float(np.deg2rad(case.rotation_deg))
    cross_axis = CROSS_AXIS if case.rotation_deg else 0.0
    built = MountedPad.built(drawing, random, errors=with_chips_turned(rotation_rad, cross_axis))
    built = replace(built, gain=random.normal(1.0, case.gain, built.gain.shape))
    tolerance = Tolerance(
        1e-4, 1e-4, 0.0, case.gain, 0.05, rotation_rad, cross_axis, pad_tilt_rad=float(np.deg2rad(1.0))
    )
    gains = selftested(built, np.random.default_rng([*seed, 1])) if case.selftest else None
    found = mountings(built, drawing, tolerance, random, gains=gains)
    return [
        (*_contact_error(built, drawing, found[kind], contact), _shear_error(built, drawing, found[kind], sheared))
        for kind in KINDS
    ]


def _contact_error(built: MountedPad, drawing: Pad, mounting: Mounting, contact: ContactModel) -> tuple[float, float]:
    """Mean absolute error of x and y (m) and of the force (N), over the pad."""
    place, force = [], []
    for x_mm, y_mm, force_n in ((x, y, f) for x in GRID_MM for y in GRID_MM for f in FORCES_N):
        found = _answer(built, drawing, mounting, contact, x_mm * 1e-3, y_mm * 1e-3, force_n)
        place += [abs(found.x_m - x_mm * 1e-3), abs(found.y_m - y_mm * 1e-3)]
        force.append(abs(found.force_n - force_n))
    return float(np.mean(place)), float(np.mean(force))


def _shear_error(built: MountedPad, drawing: Pad, mounting: Mounting, contact: ContactModel) -> float:
    """Mean absolute error of both components (N)."""
    errors = []
    for x_mm, y_mm, shear_n in ((x, y, s) for x in SHEARED_MM for y in SHEARED_MM for s in SHEARS_N):
        found = _answer(built, drawing, mounting, contact, x_mm * 1e-3, y_mm * 1e-3, SHEARED_N, *shear_n)
        assert found.shear_n is not None
        errors.append(np.abs(found.shear_n - shear_n))
    return float(np.mean(errors))


def _answer(
    built: MountedPad, drawing: Pad, mounting: Mounting, contact: ContactModel, *press: float
) -> ContactEstimate:
    field = mounting.magnet_field(pressed_field(built, *press))
    estimate = solve(field, mounting.mounted(drawing), mounting.rest, free=FREE_FIELD)
    return contact.estimate(*in_nominal_frame(estimate, mounting.rest, drawing, mounting.pad_turn))
