"""A pad with four magnets in other silicone than the shipped table's: before and after `calibrate`, by its presses."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass, field, replace

import numpy as np

from fmfts.arithmetic.spline import spline_collocation
from fmfts.contact.array_model import ArrayModel
from fmfts.contact.array_response import ArrayResponse
from fmfts.pad import Array, Tolerance
from fmfts_calibrate.array_evaluate import ArrayEvaluation, evaluate_array
from fmfts_calibrate.array_fit import fit_table
from fmfts_calibrate.array_set import ArraySet
from fmfts_calibrate.array_start import starting_table
from fmfts_lab.bench.several_world import NOISE_T, RATE_HZ, SCENE, WITHIN_MM, Press, World, world
from fmfts_lab.finite_elements.array_model import linear_normal
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_lab.finite_elements.array_presses import array_slab

FORCE, THICKER_M, CAST_M = 1.2, 0.3e-3, 0.5e-3
# As built, but with magnets that were cast 0.5 mm beside their places, and a baseline that knows it.
CAST = Tolerance(1e-4, CAST_M, float(np.deg2rad(1.0)), 0.005, 0.01)
PAD = array_config().pad()
PLACES = (3, 4, 5, 7)  # along x and along y
FORCES_N = (0.5, 1.5)
TEST_PRESSES, FRAMES_A_ROW = 200, 64
PLACE_MM, FORCE_SHARE, FORCE_N = 0.05, 0.01, 0.005  # errors of the labels
AFTER_REST_T = 3e-7


@dataclass(slots=True)
class Row:
    """One table on all pads."""

    judged: list[ArrayEvaluation] = field(default_factory=list)
    chosen: list[str] = field(default_factory=list)

    def line(self, name: str) -> str:
        found, press, deviation = (
            np.concatenate([getattr(one, name)[one.answered] for one in self.judged])
            for name in ("found", "press", "deviation")
        )
        error, all_of = found - press, sum(len(one.press) for one in self.judged)
        place = np.sqrt(np.square(error[:, :2]).sum(axis=1).mean())
        force = np.sqrt(np.square(error[:, 2]).mean())
        within = np.mean(np.abs(error) <= 2.0 * deviation)
        healthy, wrong = (sum(int(getattr(one, name).sum()) for one in self.judged) for name in ("ok", "wrong"))
        chosen = ", ".join(f"{self.chosen.count(name)} {name}" for name in dict.fromkeys(self.chosen))
        return (
            f"| {name} | {place:.3f} | {force:.4f} | {within:.1%} | {healthy} of {all_of} | {wrong} | {chosen or '—'} |"
        )


def run(options: Namespace) -> None:
    start = starting_table(None, PAD)
    for name, truth in (
        (f"forces {FORCE - 1.0:+.0%}, {THICKER_M * 1e3:g} mm thicker, cast {CAST_M * 1e3:g} mm off", other(start)),
        (f"the shipped silicone, cast {CAST_M * 1e3:g} mm off", start),
    ):
        rows: dict[str | int, Row] = {"shipped": Row(), "made for it": Row()}
        rows |= {places: Row() for places in PLACES}
        for number in range(options.pads):
            one = replace(world(1000 * options.seed + 700 + number, CAST), response=truth)
            test = pressed(one, anywhere(one.random), labels_are_exact=True, frames=1)
            for key, table in (("shipped", start), ("made for it", truth)):
                rows[key].judged.append(judged(test, table))
            for places in PLACES:
                made = fit_table(pressed(one, grid(places)), name, start, NOISE_T / np.sqrt(FRAMES_A_ROW), _silent)
                rows[places].judged.append(judged(test, made.response))
                rows[places].chosen.append(made.chosen)
        print(
            f"\n| {name} | place, rms mm | force, rms N | within 2 deviations | healthy | wrong | chosen |\n"
            "| --- | --- | --- | --- | --- | --- | --- |"
        )
        for made_by, row in rows.items():
            what = made_by if isinstance(made_by, str) else f"calibrated, {len(FORCES_N) * made_by * made_by} presses"
            print(row.line(what), flush=True)


def judged(test: ArraySet, table: ArrayResponse) -> ArrayEvaluation:
    return evaluate_array(test, ArrayModel(table, ""), SCENE, RATE_HZ, NOISE_T)


def other(start: ArrayResponse) -> ArrayResponse:
    """The table of a thicker slab, by finite elements for small forces, in silicone that needs FORCE times the force.
    Its curvature over the force is that of the start, at the force with the same movement.
    """
    size = len(start.coefficient) - 2
    knots: Array = start.first_mm + start.spacing_mm * np.arange(size, dtype=np.float64)
    slab = array_slab()
    here, thick = (linear_normal(one, knots) for one in (slab, replace(slab, thickness_m=slab.thickness_m + THICKER_M)))
    share = float(np.abs(thick[..., 2::5]).max() / np.abs(here[..., 2::5]).max())
    spline = np.linalg.inv(spline_collocation(size))[:, 1:-1]
    powers = np.arange(1, start.coefficient.shape[2] + 1)
    coefficient = start.coefficient * np.where(powers > 1, share**powers, 1.0)[:, None]
    coefficient[:, :, 0] += np.einsum("ai,bj,ijc->abc", spline, spline, thick - here)
    coefficient = coefficient * (FORCE**-powers)[:, None]
    return replace(start, coefficient=coefficient, shear=start.shear * share / FORCE, scale_n=start.scale_n * FORCE)


def grid(places: int) -> Array:
    along = np.linspace(-WITHIN_MM, WITHIN_MM, places).tolist()
    return np.array([[x, y, force] for x in along for y in along for force in FORCES_N])


def anywhere(random: np.random.Generator) -> Array:
    places = random.uniform(-WITHIN_MM, WITHIN_MM, (TEST_PRESSES, 2))
    return np.column_stack([places, random.uniform(0.1, 2.0, TEST_PRESSES)])


def pressed(one: World, press: Array, labels_are_exact: bool = False, frames: int = FRAMES_A_ROW) -> ArraySet:
    """The set of presses (K, 3) as a stage and `collect` make it. frames: that a row is the mean of."""
    deviation = np.column_stack([np.full((len(press), 2), PLACE_MM), np.hypot(FORCE_SHARE * press[:, 2], FORCE_N)])
    really = press if labels_are_exact else press + deviation * one.random.normal(size=press.shape)
    change = []
    for x, y, force in really.tolist():
        moved = one.pressed([Press(x, y, force)])
        frame = np.mean([one.sensed(moved, one.ambient_t) for _ in range(frames)], axis=0)
        change.append((one.mounting.magnet_field(frame) - one.mounting.rest_field_t).ravel())
    labels = np.concatenate([press, np.zeros((len(press), 2))], axis=1)
    lines = tuple(range(2, len(press) + 2))
    around = np.full(len(press), AFTER_REST_T)
    return ArraySet(labels, deviation, lines, "", np.array(change), around, PAD, one.mounting, "")


def _silent(_: str) -> None:
    pass
