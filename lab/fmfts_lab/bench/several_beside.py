"""One finger on the pad with one magnet and on the pad with four: what it costs to look for two."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import numpy as np

from fmfts.contact import ContactModel
from fmfts.pad import Array, Tolerance
from fmfts.pipeline.drawn import in_nominal_frame
from fmfts.pose import FREE_FIELD, solve
from fmfts_lab.bench.recorded import bare_and_rest, pressed_field
from fmfts_lab.bench.several_world import BUILT, BY_HAND, EXACT, NOISE_T, WITHIN_MM, Press, worlds
from fmfts_lab.bench.workspace import standard_pad
from fmfts_simulation.mounted import MountedPad, with_chips_turned

FORCES_N, PRESSES_OF_A_PAD = (0.1, 2.0), 50
NOTHING = np.zeros(3)


def run(options: Namespace) -> None:
    print("| one finger, no shear | one magnet, four sensors: rms mm, N | four magnets, eight sensors: rms mm, N |")
    print("| --- | --- | --- |")
    for name, tolerance in (("as drawn", EXACT), ("as built", BUILT), ("by hand, gains 5 %", BY_HAND)):
        one, four = _one_magnet(options, tolerance), _four_magnets(options, tolerance)
        cells = [f"{_rms(errors[:, :2]):.3f}, {_rms(errors[:, 2:]):.4f}" for errors in (one, four)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def _press(random: np.random.Generator) -> Array:
    """(3,) x, y in mm, and the force."""
    return np.append(random.uniform(-WITHIN_MM, WITHIN_MM, 2), random.uniform(*FORCES_N))


def _one_magnet(options: Namespace, tolerance: Tolerance) -> Array:
    """(K, 3) errors in mm and N. Pads are built within `tolerance`; the solver is warm, the ambient field free."""
    drawing, errors = standard_pad(), []
    contact = ContactModel.load("default", drawing)
    for number in range(-(-options.frames // PRESSES_OF_A_PAD)):
        random = np.random.default_rng((1000 * options.seed + number, 24))
        built = MountedPad.built(
            drawing, random, errors=with_chips_turned(tolerance.sensor_rotation_rad, tolerance.cross_axis)
        )
        if tolerance is EXACT:
            built = replace(MountedPad.exact(drawing), ambient_t=built.ambient_t)
        else:
            magnet = drawing.magnet.with_remanence(drawing.magnet.remanence_t * random.normal(1.0, tolerance.remanence))
            built = replace(
                built,
                gain=random.normal(1.0, tolerance.gain, built.gain.shape),
                pad=replace(built.pad, magnet=magnet),
            )
        _, mounting = bare_and_rest(built, drawing, tolerance, random, NOISE_T)
        for _ in range(PRESSES_OF_A_PAD):
            press = _press(random)
            field = pressed_field(built, press[0] * 1e-3, press[1] * 1e-3, press[2])
            seen = mounting.magnet_field(field + random.normal(0.0, NOISE_T, field.shape))
            estimate = solve(seen, mounting.mounted(drawing), mounting.rest, free=FREE_FIELD)
            found = contact.estimate(*in_nominal_frame(estimate, mounting.rest, drawing, mounting.pad_turn))
            errors.append(np.array([found.x_m * 1e3, found.y_m * 1e3, found.force_n]) - press)
    return np.array(errors)


def _four_magnets(options: Namespace, tolerance: Tolerance) -> Array:
    """(K, 3) errors in mm and N of frames that report a finger; the lightest presses at the rim may report none."""
    errors = []
    for one in worlds(options.frames, tolerance, options.seed, PRESSES_OF_A_PAD):
        for _ in range(PRESSES_OF_A_PAD):
            press = _press(one.random)
            x, y, force = press.tolist()
            fit = one.counter().update(one.measured(one.pressed([Press(x, y, force)])), NOTHING).fit
            if len(fit.fingers) == 1:
                errors.append(fit.fingers[0] - press)
    return np.array(errors)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values).sum(axis=1))))
